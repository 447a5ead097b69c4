"""The scripts that stand where the original had launch files."""
