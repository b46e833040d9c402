"""Pictures that move or can be explored: animated glTF, a page that plays a run, plots to zoom into."""
