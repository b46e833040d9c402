"""Arms from modules: the library, assembly, every arm that a library can make, and the best of them for a task."""
