"""Which gain of your own controller takes OneBot through a corridor, whatever its heading?

Run it with `python 13_study.py`. `onebot evaluate 13_study.py --out study.parquet` also writes the
table and a recording of each failed run; it can be interrupted and resumed.
"""

from onebot_control import Simulation
from onebot_control.evaluation import Case, evaluate, grid, summary


def episode(case: Case) -> dict[str, object]:
    """Drive through the first corridor of the maze, between its walls as the lidar measures."""
    with Simulation(world="maze", yaw=case["yaw"], seed=case["seed"], sensors=True) as simulation:
        robot = simulation.robot
        while robot.pose.x < 1.0 and not robot.collided and simulation.time < 10.0:
            scan = robot.scan()
            left, right = scan.at(1.2), scan.at(-1.2)  # m, at these angles in rad
            robot.drive(0.4, case["gain"] * (min(left, 1.0) - min(right, 1.0)))
            simulation.run(0.1)
        return {"reached": robot.pose.x >= 1.0, "seconds": round(simulation.time, 2)}


cases = grid(gain=[0.2, 1.0], yaw=[-0.6, -0.3, 0.0, 0.3, 0.6], seed=range(2))

if __name__ == "__main__":
    print(summary(evaluate(episode, cases)))
