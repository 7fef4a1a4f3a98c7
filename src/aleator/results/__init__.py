"""The result of an identification as plain data: its values, its law, its document, its text."""
