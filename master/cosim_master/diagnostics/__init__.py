"""Problems and how they are said: errors, limitations, near names."""
