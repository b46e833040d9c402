"""Built-in arms: one TOML database each, with source, date and licence of every number."""
