"""Controllers compared on the same motions: errors, path accuracy, settling, repeatability."""
