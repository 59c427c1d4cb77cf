# SPDX-License-Identifier: Apache-2.0
"""Physical effects that the paper's model lacks; each module here that defines `EFFECT` is one."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType

from cfd_pneumatic.model.effects.curve import AGAINST as CURVE_AGAINST
from cfd_pneumatic.model.effects.curve import BOTH_WAYS, CURVE, LIFTING, ONE_WAY, is_of_flow
from cfd_pneumatic.model.effects.curve import ENTERS as CURVE_ENTERS
from cfd_pneumatic.model.effects.effect import FUNCTIONS, Data, Effect, EffectParameter, ForceMoment, Moment
from cfd_pneumatic.model.effects.force_curve import AGAINST as FORCE_CURVE_AGAINST
from cfd_pneumatic.model.effects.force_curve import ENTERS as FORCE_CURVE_ENTERS
from cfd_pneumatic.model.effects.force_curve import FORCE_CURVE
from cfd_pneumatic.model.effects.knots import KNOTS


def _modules() -> dict[str, ModuleType]:
    """Return the modules that define an effect, by its name, in the order in which effects enter the model."""
    modules = [importlib.import_module(f'{__name__}.{found.name}') for found in pkgutil.iter_modules(__path__)]
    effects = [module for module in modules if isinstance(getattr(module, 'EFFECT', None), Effect)]
    return {
        module.EFFECT.name: module for module in sorted(effects, key=lambda one: (one.EFFECT.rank, one.EFFECT.name))
    }


MODULES = _modules()
"""Module of each effect, by name."""

CORES: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if module.EFFECT.core}
"""What stands in the linear core's place, by name."""

GENERIC: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if module.EFFECT.generic}
"""What is drawn from data where none of the effects explains them, by name."""

EFFECTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if name not in {*CORES, *GENERIC}}
"""Each effect, by name, in the order in which they enter the model."""

FORCE_EFFECTS: dict[str, Effect] = {name: effect for name, effect in EFFECTS.items() if hasattr(MODULES[name], 'force')}
"""Those on the contact force, in that order."""

PRESSURE_EFFECTS: dict[str, Effect] = {name: effect for name, effect in EFFECTS.items() if name not in FORCE_EFFECTS}
"""Those on a cylinder's pressure, in that order."""

FORCE_PARTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if hasattr(module, 'force')}
"""Those on the force and what is drawn from data, in that order: what can be switched on in the contact force."""

PRESSURE_PARTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if name not in FORCE_PARTS}
"""Those, the cores and what is drawn from data, in that order: what can be switched on in a cylinder."""
