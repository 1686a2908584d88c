"""The compiled loop: calls of FMI functions, its tables, the macro step."""
