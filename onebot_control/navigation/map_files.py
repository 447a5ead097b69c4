"""Stub for now."""


def load_map(path):
    raise NotImplementedError


def save_map(path, grid):
    raise NotImplementedError
