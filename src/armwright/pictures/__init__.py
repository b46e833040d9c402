"""Moving and interactive pictures: animated glTF, a page with a player, plots with zoom."""
