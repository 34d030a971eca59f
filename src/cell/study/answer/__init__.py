"""What a study found: tables and a page."""
