"""Results as folders of files, written and read back."""
