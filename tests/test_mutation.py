"""The mutation run's table, which has to follow every move; the run itself is not a test."""

from tests.mutation.targets import missing


def test_the_mutation_run_names_what_exists() -> None:
    assert not missing()
