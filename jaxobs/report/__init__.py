"""What a person looks at: figures, tables on the terminal, one HTML page."""
