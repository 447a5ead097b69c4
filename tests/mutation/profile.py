"""pytest's plugin for a mutant's tests: the same examples each time, and none made simpler."""

from hypothesis import Phase, settings

settings.register_profile(
    "mutation", derandomize=True, database=None, phases=(Phase.explicit, Phase.generate)
)
settings.load_profile("mutation")
