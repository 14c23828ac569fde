"""A moving robot and the same robot at rest."""

import numpy as np
import pytest
from view_robots import AXIS, ORANGE, Run, chain, visual

from robodyn.joints import Fixed, Prismatic, Revolute
from robodyn.model import Box, Cylinder, Link, Sphere


@pytest.fixture
def run():
    links = (
        Link("base", visuals=(visual(Box((0.5, 0.5, 0.1))),)),
        Link("arm", visuals=(visual(Box((0.6, 0.3, 0.3)), ORANGE), visual(Sphere(0.1)))),
        Link("slide", visuals=(visual(Cylinder(0.1, 0.4), (0.1, 0.3, 0.8, 0.5)),)),
    )
    return Run(chain(*links, joints=[Fixed(), Revolute.from_axis(AXIS), Prismatic.from_axis(np.eye(3)[0])]), np.linspace(0.0, 1.0, 31))


@pytest.fixture
def still(run):
    """The same robot at one instant."""
    run.times = np.zeros(1)
    return run
