"""Problems and their messages: errors, limitations, near names."""
