"""What an identification leaves: its values, what can still be asked of it, its documents."""
