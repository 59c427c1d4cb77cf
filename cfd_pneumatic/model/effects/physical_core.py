# SPDX-License-Identifier: Apache-2.0
"""
The physical core: equations (1) to (11) of the paper without linearisation.

The gains hold at a reference pressure and position. Flows depend on the pressures on both sides of a valve (ISO 6358),
stiffness and flows on the chamber's volume, and sensing on the density. Compression warms the air, and the walls take
the heat. The physical core is not a missing effect: a search starts with it or with the linear core.
"""

from __future__ import annotations

import math

from cfd_pneumatic.model.effects import heat_transfer
from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
from cfd_pneumatic.model.kernels import inlined
from cfd_pneumatic.model.lanes import some, where
from cfd_pneumatic.model.lanewise import exp, log

SMALLEST_FLOW = 0.05
"""Least share of the choked flow [-]; the slope of an orifice's flow is infinite at equal pressures."""

SMALLEST_VOLUME = 0.05
"""Least volume / volume at the reference [-]."""

SLOWEST_LOSS = 0.01
"""Slower walls count as none, and the change of state is polytropic, as in the paper [1/s]."""

STARTING_SUPPLY = 1.2
"""Lowest starting supply pressure / highest recorded pressure [-]."""

STARTING_STIRRING = 3.0
"""Starting value of `stirring`: motion hardly adds to the heat transfer [s/m]."""

SMALLEST_RISE = 1e3
"""Smallest assumed rise of recorded pressures above the reference [Pa]."""

FAST = 0.1
"""Speed above which stirring is constant [m/s]; otherwise no step would be short enough."""

STARTING_ENTRANCE = HIDDEN_SILENCER = 1e-6
"""Starting values of `entrance` and `silencer` with hardly any influence [1/Pa]."""

STARTING_OPENING = 0.6
"""
Largest opening of the relief valve / opening of the silencer for a visible starting silencer [-].

A silencer behind a choked valve is visible only if this ratio exceeds the critical ratio.
"""


@inlined
def orifice_flow(upstream, downstream, critical):
    """Return an orifice's flow as the upstream pressure of an equal choked flow [Pa]; equation (1), ISO 6358."""
    unchoked = max(downstream - critical * upstream, 0.0) / (1.0 - critical)
    least = SMALLEST_FLOW * upstream
    return math.sqrt(max(upstream * upstream - unchoked * unchoked, least * least))


@inlined
def pressure_between(opened, upstream, downstream, critical):
    """
    Return the pressure between two orifices in series [Pa]; `opened` is the first opening / the second opening.

    By the ellipse of ISO 6358 the squared flows are quadratic in this pressure: a x^2 + b x + c is zero at equal flows.
    The ellipse of a choked orifice is omitted.
    """
    flow = (opened * upstream) * (opened * upstream)  # squared flow, if the first is choked
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
    # the form of the root without cancellation
    return where(b > 0.0, -2.0 * c, root - b) / where(b > 0.0, b + root, 2.0 * a)


@inlined
def hold(moment, pressure, position, supply, b, opens, vents, n, loss, control, silencer, entrance, stirring):
    """
    Return the values that are constant while the set-point and the piston's speed are.

    The values include the valves' openings relative to the flow at the reference [1/Pa] and the inverse of the walls'
    time constant [1/s]. Free and forced convection add up as a root of squares.
    """
    log_ratio = log(moment.setpoint / pressure)
    opened = exp(opens * log_ratio) / orifice_flow(supply, pressure, b)
    vented = exp(vents * log_ratio) / orifice_flow(pressure, moment.ambient, b)
    forced = stirring * min(abs(moment.rate), FAST)
    walls = loss * math.sqrt(1.0 + forced * forced)
    warmth = loss / (loss + SLOWEST_LOSS)
    return pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance


@inlined
def density(
    dense, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the reference volume, by K_x = n p A / V of equation (12), / the chamber's volume [-]."""
    stiff = n * pressure
    return dense * stiff / max(stiff + moment.k_x * (moment.x - position), SMALLEST_VOLUME * stiff)


@inlined
def error(
    value, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the error [Pa] that gives the flow of `value` through the silencer if there were no silencer."""
    opening = silencer * max(-value, 0.0)
    if some(opening > 0.0):
        behind = pressure_between(opening, moment.p, moment.ambient, b)
        value *= orifice_flow(moment.p, behind, b) / orifice_flow(moment.p, moment.ambient, b)
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
    """Return the pressure rate of the flow [Pa/s], equations (1), (3) and (11)."""
    exhausts = value < 0.0
    passes = orifice_flow(where(exhausts, moment.p, supply), where(exhausts, moment.ambient, moment.p), b)
    share = where(exhausts, vented, opened) * passes * moment.dense
    return value * share * moment.p / (moment.p - where(exhausts, heat * warmth, 0.0))


@inlined
def time_constant(
    tau, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return tau [s], inverse to the density in the aspirator tube, equation (4), with the loss at its entrance."""
    entering = math.sqrt(1.0 + 4.0 * entrance * abs(moment.p - moment.p_f))
    return tau * (1.0 + entering) * pressure / (moment.p + moment.p_f)


@inlined
def chamber(
    rate, moment, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the outlet pressure's rate with the control chamber's intake and the walls' cooling [Pa/s]."""
    return rate - control * moment.sensing * moment.dense - heat_transfer.cooling(moment, heat, moment.dense * walls)


@inlined
def evolve(
    moment, rate, heat, pressure, position, supply, b, opened, vented, n, warmth, walls, control, silencer, entrance
):
    """Return the rate of the pressure due to temperature [Pa/s]."""
    return (heat_transfer.warming(moment, rate, heat, moment.dense * walls, n),)


def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the middle of the recorded ranges as the reference, with several walls and silencers."""
    position, pressure = 0.5 * (data['x_low'] + data['x_high']), data['level']
    supply = max(EFFECT.null[2], STARTING_SUPPLY * data['highest_pressure'])
    visible_silencer = STARTING_OPENING / max(data['highest_pressure'] - pressure, SMALLEST_RISE)
    return [
        (pressure, position, supply, *EFFECT.null[3:7], loss, 0.01, silencer, STARTING_ENTRANCE, STARTING_STIRRING)
        for loss, silencer in (
            (0.3, HIDDEN_SILENCER),
            (5.0, HIDDEN_SILENCER),
            (30.0, HIDDEN_SILENCER),
            (5.0, visible_silencer),
        )
    ]


def quickens(pressure: float, x: float, k_x: float, *parameters: float) -> float:
    """Return the largest factor of a gain at a pressure [Pa] and a displacement [m]."""
    reference, position, supply, critical, opens, vents, exponent, *_ = parameters
    volume = max(1.0 + k_x * (x - position) / (exponent * reference), SMALLEST_VOLUME)
    relative = pressure / reference
    charged = supply / float(orifice_flow(supply, reference, critical))
    return max(charged * relative**opens, relative ** (1.0 + vents), relative, 1.0) / volume


def fastest(speed: float, *parameters: float) -> float:
    """Return the inverse of the walls' time constant at a speed [1/s]."""
    loss, stirring = parameters[7], parameters[11]
    return loss * math.hypot(1.0, stirring * min(speed, FAST))


EFFECT = Effect(
    name='physical_core',
    description="the paper's equations (1) to (11) without linearisation",
    inspect='no part: flows and stiffness that depend on pressure and position are no fault',
    core=True,
    covers=('operating_point', 'volume_variation', 'heat_transfer'),
    parameters=(
        EffectParameter('pressure', 'Pa', 1e4, 1e7, 2e5, 'absolute pressure at which the gains hold', choice=True),
        EffectParameter(
            'position', 'm', -10.0, 10.0, 0.0, 'displacement, growing the chamber, at which the gains hold', choice=True
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
            'control_volume', '-', 0.0, 0.3, 0.0, "volume of the regulator's control chamber / volume of the cylinder"
        ),
        EffectParameter(
            'silencer',
            '1/Pa',
            0.0,
            1e-3,
            0.0,
            'inverse of the error at which the relief valve opens as far as the silencer',
        ),
        EffectParameter(
            'entrance',
            '1/Pa',
            0.0,
            1e-3,
            0.0,
            'inverse of the pressure drop at which the aspirator tube loses as much at its entrance as along its wall',
        ),
        EffectParameter(
            'stirring', 's/m', 0.0, 50.0, 0.0, 'inverse of the speed at which forced convection equals free convection'
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
