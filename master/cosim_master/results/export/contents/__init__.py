"""The contents of a recording in the form that several formats share: motion, texts, pictures, messages."""
