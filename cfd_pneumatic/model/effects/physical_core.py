# SPDX-License-Identifier: Apache-2.0
"""
The physical core: equations (1) to (11) of the paper before they were linearised.

The gains hold at a reference pressure and position. From there flows follow the pressures on both sides of a valve (ISO
6358), stiffness and flows the chamber's volume, sensing the density; air warms up as it is compressed, and its walls
take that up. It is no effect that a device lacks: a search begins beside it or without it.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects import heat_transfer
from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import some, where
from cfd_pneumatic.model.lanewise import exp, log

SMALLEST_FLOW = 0.05
"""Share of the choked flow that always passes: an orifice's slope is infinite where the pressures are equal [-]."""

SMALLEST_VOLUME = 0.05
"""Share of the volume at the reference that is always left [-]."""

SLOWEST_LOSS = 0.01
"""Walls that take longer are none: then the change of state is polytropic, as the paper has it [1/s]."""

STARTING_SUPPLY = 1.2
"""Times the highest pressure: where a data sheet's supply is lower, a search starts from that [-]."""

STARTING_STIRRING = 3.0
"""Motion that hardly adds to the walls, which a search starts from [s/m]."""

SMALLEST_RISE = 1e3
"""Rise above the reference that recordings are taken to have at least [Pa]."""

FAST = 0.1
"""Speed from which on motion stirs no more: else no step would be short enough [m/s]."""

STARTING_ENTRANCE = HIDDEN_SILENCER = 1e-6
"""An entrance and a silencer that hardly matter, which a search starts from [1/Pa]."""

STARTING_OPENING = 0.6
"""
How far the relief valve opens, at most, against a silencer that a search starts from [-].

Behind a choked valve a silencer is not seen before that is the critical ratio.
"""


@inlined
def passed(upstream, downstream, critical):
    """Return what passes a hole, as the upstream pressure of which as much is choked, equation (1) by ISO 6358 [Pa]."""
    unchoked = max(downstream - critical * upstream, 0.0) / (1.0 - critical)
    least = SMALLEST_FLOW * upstream
    return math.sqrt(max(upstream * upstream - unchoked * unchoked, least * least))


@inlined
def between(opened, upstream, downstream, critical):
    """
    Return the pressure between two orifices in a row, of which the first is opened so many times as far [Pa].

    By the ellipse of ISO 6358 the flows' squares are quadratic in it: a x^2 + b x + c grows through zero where both
    orifices pass the same. Each is choked, and its flow's ellipse left out, or not.
    """
    flow = (opened * upstream) * (opened * upstream)  # squared, where the first is choked
    ellipse = 1.0 / ((1.0 - critical) * (1.0 - critical))
    edge = critical * upstream  # below it the first is choked
    low = max(downstream - critical * edge, 0.0)
    first = where(flow > edge * edge - ellipse * low * low, ellipse, 0.0) * opened * opened
    edge = downstream / critical  # above it the second is choked
    high = max(edge - critical * upstream, 0.0)
    second = where(flow - first * high * high < edge * edge, ellipse, 0.0)
    a = 1.0 - second * critical * critical + first
    b = 2.0 * critical * (second * downstream - first * upstream)
    c = critical * critical * first * upstream * upstream - second * downstream * downstream - flow
    root = math.sqrt(max(b * b - 4.0 * a * c, 0.0))
    # of the root's two forms the one that keeps its digits
    return where(b > 0.0, -2.0 * c, root - b) / where(b > 0.0, b + root, 2.0 * a)


@inlined
def hold(moment, pressure, position, supply, b, opens, vents, n, loss, control, silencer, entrance, stirring):
    """
    Return what stays the same while the set-point and the piston's speed do.

    Among it are the valves' openings against what passes at the reference [1/Pa], and the inverse of the walls' time
    constant [1/s], where free and forced convection add up as roots of squares.
    """
    grown = log(moment.setpoint / pressure)
    opened = exp(opens * grown) / passed(supply, pressure, b)
    vented = exp(vents * grown) / passed(pressure, moment.ambient, b)
    forced = stirring * min(abs(moment.rate), FAST)
    walls = loss * math.sqrt(1.0 + forced * forced)
    warmth = loss / (loss + SLOWEST_LOSS)
    return pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance


@inlined
def density(
    dense, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the volume at the reference, K_x = n p A / V there by equation (12), against the chamber's [-]."""
    stiff = n * pressure
    return dense * stiff / max(stiff + moment.k_x * (moment.x - position), SMALLEST_VOLUME * stiff)


@inlined
def error(
    value, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the error [Pa] that would let as much out if no silencer stood behind the relief valve."""
    opened = silencer * max(-value, 0.0)
    if some(opened > 0.0):
        behind = between(opened, moment.p, moment.ambient, b)
        value *= passed(moment.p, behind, b) / passed(moment.p, moment.ambient, b)
    return value


@inlined
def velocity_gain(
    k_x, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return K_x [Pa/m] at a pressure and in a volume, equation (11)."""
    return k_x * (moment.p / pressure) * moment.dense


@inlined
def flow(
    value, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the pressure rate that the flow makes [Pa/s], equations (1), (3) and (11)."""
    exhausts = value < 0.0
    passes = passed(where(exhausts, moment.p, supply), where(exhausts, moment.ambient, moment.p), b)
    share = where(exhausts, vented, opened) * passes * moment.dense
    return value * share * moment.p / (moment.p - where(exhausts, heat * warmth, 0.0))


@inlined
def time_constant(
    tau, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return tau [s]: inverse to the density in the aspirator tube, equation (4), longer where its entrance counts."""
    entering = math.sqrt(1.0 + 4.0 * entrance * abs(moment.p - moment.p_f))
    return tau * (1.0 + entering) * pressure / (moment.p + moment.p_f)


@inlined
def chamber(
    rate, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the outlet pressure's rate [Pa/s]: the control chamber draws on it, the walls cool it."""
    return rate - control * moment.sensing * moment.dense - heat_transfer.cooling(moment, heat, moment.dense * walls)


@inlined
def evolve(
    moment, rate, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the rate at which pressure due to temperature builds up and goes [Pa/s]."""
    return (heat_transfer.warming(moment, rate, heat, moment.dense * walls, n),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the middle of what was recorded as the reference, beside walls of several kinds."""
    position, pressure = 0.5 * (data['x_low'] + data['x_high']), data['level']
    supply = max(EFFECT.null[2], STARTING_SUPPLY * data['highest_pressure'])
    seen = STARTING_OPENING / max(data['highest_pressure'] - pressure, SMALLEST_RISE)
    return [
        (pressure, position, supply, *EFFECT.null[3:7], loss, 0.01, silencer, STARTING_ENTRANCE, STARTING_STIRRING)
        for loss, silencer in ((0.3, HIDDEN_SILENCER), (5.0, HIDDEN_SILENCER), (30.0, HIDDEN_SILENCER), (5.0, seen))
    ]


def quickens(pressure: float, x: float, k_x: float, *own: float) -> float:
    """Return by how much the gains are larger at a pressure [Pa] and a displacement [m]."""
    reference, position, supply, critical, opens, vents, exponent, *_ = own
    volume = max(1.0 + k_x * (x - position) / (exponent * reference), SMALLEST_VOLUME)
    relative = pressure / reference
    charged = supply / float(passed(supply, reference, critical))
    return max(charged * relative**opens, relative ** (1.0 + vents), relative, 1.0) / volume


def fastest(speed: float, *own: float) -> float:
    """Return the inverse of the walls' time constant at a speed [1/s]."""
    loss, stirring = own[7], own[11]
    return loss * math.hypot(1.0, stirring * min(speed, FAST))


EFFECT = Effect(
    name='physical_core',
    description="the paper's equations (1) to (11) before they were linearised",
    core=True,
    covers=('operating_point', 'volume_variation', 'heat_transfer'),
    parameters=(
        EffectParameter('pressure', 'Pa', 1e4, 1e7, 2e5, 'absolute pressure at which the gains hold', choice=True),
        EffectParameter(
            'position',
            'm',
            -10.0,
            10.0,
            0.0,
            'displacement that grows the chamber at which the gains hold',
            choice=True,
        ),
        EffectParameter(
            'supply', 'Pa', 1e5, 5e6, 8e5, 'absolute supply pressure', logarithmic=True, is_supply=True, spread=0.3
        ),
        EffectParameter('critical_ratio', '-', 0.1, 0.6, 0.4, 'pressure ratio at which the valves choke', spread=0.2),
        EffectParameter(
            'supply_growth',
            '-',
            -2.0,
            4.0,
            0.0,
            "exponent of the set-point in the supply valve's gain",
            of_pressure=True,
            spread=1.0,
        ),
        EffectParameter(
            'relief_growth',
            '-',
            -2.0,
            4.0,
            0.0,
            "exponent of the set-point in the relief valve's gain",
            of_pressure=True,
            spread=1.0,
        ),
        EffectParameter('exponent', '-', 1.0, 1.4, 1.3, 'polytropic exponent of a fast change', spread=0.2),
        EffectParameter(
            'wall_loss', '1/s', 0.0, 1e3, 0.0, 'inverse of the time constant m c_v / (h A), at ambient pressure'
        ),
        EffectParameter(
            'control_volume', '-', 0.0, 0.3, 0.0, "the regulator's control chamber against the cylinder's volume"
        ),
        EffectParameter(
            'silencer',
            '1/Pa',
            0.0,
            1e-3,
            0.0,
            'inverse of the error at which the relief valve is opened as far as the silencer behind it',
        ),
        EffectParameter(
            'entrance',
            '1/Pa',
            0.0,
            1e-3,
            0.0,
            "inverse of the drop at which the aspirator tube's entrance takes as much as its wall",
        ),
        EffectParameter(
            'stirring',
            's/m',
            0.0,
            50.0,
            0.0,
            'inverse of the speed from which motion stirs the air more than warmth does',
        ),
    ),
    starts=starts,
    quickens=quickens,
    fastest=fastest,
    states=1,
    held=12,
    follows='chamber',
    rank=10,
)
