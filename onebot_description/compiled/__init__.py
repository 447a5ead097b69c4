"""The compiled library of this package: building and loading it."""
