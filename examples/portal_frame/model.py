"""Drift of a portal frame on column bases that give way: a second-order analysis of OpenSees."""

import openseespy.opensees as ops

HEIGHT, SPAN = 4.0, 6.0  # m
STEEL = 210e6  # kN/m2
AREA, INERTIA = 5.4e-3, 3.7e-5  # m2, m4
WEIGHT = 200.0  # kN on each column
STEPS = 10


def drift(load, base):
    """Millimetres that the beam moves under a horizontal `load` (kN).

    `base` is the stiffness of a column's base against rotation, MN m/rad.
    """
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    corners = [(0.0, 0.0), (0.0, HEIGHT), (SPAN, HEIGHT), (SPAN, 0.0), (0.0, 0.0), (SPAN, 0.0)]
    for node, place in enumerate(corners, start=1):
        ops.node(node, *place)
    ops.uniaxialMaterial("Elastic", 1, 1e3 * base)
    for ground, column in ((5, 1), (6, 4)):
        ops.fix(ground, 1, 1, 1)
        ops.equalDOF(ground, column, 1, 2)
        ops.element("zeroLength", ground, ground, column, "-mat", 1, "-dir", 6)
    ops.geomTransf("PDelta", 1)
    for element, ends in enumerate([(1, 2), (2, 3), (4, 3)], start=1):
        ops.element("elasticBeamColumn", element, *ends, AREA, STEEL, INERTIA, 1)
    ops.timeSeries("Linear", 1)
    ops.pattern("Plain", 1, 1)
    ops.load(2, load, -WEIGHT, 0.0)
    ops.load(3, 0.0, -WEIGHT, 0.0)
    ops.constraints("Transformation")
    ops.numberer("RCM")
    ops.system("BandGeneral")
    ops.test("NormDispIncr", 1e-12, 50)
    ops.algorithm("Newton")
    ops.integrator("LoadControl", 1.0 / STEPS)
    ops.analysis("Static")
    if ops.analyze(STEPS) != 0:
        raise RuntimeError("OpenSees found no equilibrium")
    return 1e3 * ops.nodeDisp(2, 1)
