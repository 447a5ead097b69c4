"""Runs an episode, an ordinary function, for many cases, and returns a table of the results.

Example::

    from onebot_control.evaluation import Case, evaluate, grid

    def drive_home(case: Case) -> dict[str, object]:
        with Simulation(world="maze", seed=case["seed"], sensors=True) as simulation:
            ...
            return {"reached": ..., "seconds": simulation.time}

    table = evaluate(drive_home, grid(seed=range(100), lookahead=[0.3, 0.6]))

``onebot evaluate`` does this with the function and the cases of a file.
"""

from onebot_control.evaluation.cases import Case, grid
from onebot_control.evaluation.report import summary
from onebot_control.evaluation.study import evaluate

__docformat__ = "google"

__all__ = ["Case", "evaluate", "grid", "summary"]
