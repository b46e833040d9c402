"""What a run leaves: rows and reducers, datasets, files, statistics, pictures."""
