"""The radio: who hears whom, when, and what is lost."""
