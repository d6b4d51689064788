"""Writing of folders and files of results, whole or not at all."""
