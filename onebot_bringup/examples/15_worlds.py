"""In how many of 300 generated worlds does OneBot find its way, depending on their clutter?

Run it with `onebot evaluate 15_worlds.py --out worlds.parquet`. The table has a row for each world,
and each failed run leaves a recording.
"""

from onebot_control import Simulation
from onebot_control.evaluation import Case, evaluate, grid, summary
from onebot_description.description.clutter import clutter, parameters_of


def episode(case: Case) -> dict[str, object]:
    """Drive to the other side of a field of cylinders, with the lidar and the wheels alone."""
    world = f"clutter:seed={case['seed']},density={case['density']}"
    field = clutter(parameters_of(world))
    with Simulation(world=world, sensors=True) as simulation:
        robot = simulation.robot
        robot.go_to(*field.goal)
        simulation.run(until=lambda: robot.collided or not robot.navigating, timeout=200.0)
        return {
            "reached": robot.navigation.status == "arrived" and not robot.collided,
            "seconds": round(simulation.time, 2),
            "reason": robot.navigation.reason,
        }


cases = grid(density=[0.15, 0.2, 0.25], seed=range(100))

if __name__ == "__main__":
    print(summary(evaluate(episode, cases)))
