"""One run: started, driven, ended."""
