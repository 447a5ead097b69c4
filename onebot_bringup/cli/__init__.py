"""The ``onebot`` command."""
