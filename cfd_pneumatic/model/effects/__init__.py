# SPDX-License-Identifier: Apache-2.0
"""Physical effects that the paper's model lacks. Each module that defines `EFFECT` is an effect."""

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
    """Return the modules that define an effect, by the effect's name, in the order of application in the model."""
    modules = [importlib.import_module(f'{__name__}.{module.name}') for module in pkgutil.iter_modules(__path__)]
    effects = [module for module in modules if isinstance(getattr(module, 'EFFECT', None), Effect)]
    effects.sort(key=lambda module: (module.EFFECT.rank, module.EFFECT.name))
    return {module.EFFECT.name: module for module in effects}


MODULES = _modules()
"""Module of each effect, by name."""

CORES: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if module.EFFECT.core}
"""Cores that replace the linear core, by name."""

GENERIC: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if module.EFFECT.generic}
"""Curves that are estimated if no effect explains the data, by name."""

EFFECTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if name not in {*CORES, *GENERIC}}
"""Effects, by name, in the order of application in the model."""

FORCE_EFFECTS: dict[str, Effect] = {name: effect for name, effect in EFFECTS.items() if hasattr(MODULES[name], 'force')}
"""Effects on the contact force, by name, in the order of application."""

PRESSURE_EFFECTS: dict[str, Effect] = {name: effect for name, effect in EFFECTS.items() if name not in FORCE_EFFECTS}
"""Effects on a cylinder's pressure, by name, in the order of application."""

FORCE_PARTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if hasattr(module, 'force')}
"""Effects and curves that can be switched on in the contact force, by name, in the order of application."""

PRESSURE_PARTS: dict[str, Effect] = {name: module.EFFECT for name, module in MODULES.items() if name not in FORCE_PARTS}
"""Effects, cores and curves that can be switched on in a cylinder, by name, in the order of application."""
