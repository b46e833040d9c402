"""Results of a run: rows and reducers, datasets, files, statistics, pictures."""
