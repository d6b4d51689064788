"""Jobs solved by worker processes, of this machine (loky) or of an executor such as Dask's."""
