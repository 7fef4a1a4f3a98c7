"""The website: its settings, its gallery, and the pages that scripts write."""
