# SPDX-License-Identifier: Apache-2.0
"""A draft of an effect's file, of a law that was drawn and has a formula: where `docs/adding_an_effect.md` goes on."""

from __future__ import annotations

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import PLACES, VARIABLES, ChannelResult, Characteristic, Identification

_BOTH_PRESSURES = 'moment.p - moment.ambient + moment.opposing - moment.ambient'
"""What the pressure is in a law of the force."""

_NUMBERS = {'a': ('height', 'how strong it is'), 'b': ('place', 'where it is'), 'c': ('length', 'over how much')}

_FILE = '''"""{title}: {words}."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
{imports}
{functions}
def starts(data: Data) -> list[tuple[float, ...]]:
    """Return what was found on {where}, and as much the other way."""
    return [{found}, {otherwise}]


EFFECT = Effect(
    name='{name}',
    description='{words}',
    parameters=(
{parameters}
    ),
    equations=(),
    starts=starts,
    shown_by='what was recorded when it was found',
    seen_against='{against}',
{more})
'''

_FUNCTION = '''
@inlined
def {function}({taken}, moment, {parameters}):
    """Return {what}."""
    z = {variable}
    {letters} = {names}
    return {result}

'''

_SLIDE = '''
@inlined
def slide(travel, {parameters}):
    """Return how far friction has turned round, -1 to 1."""
    return (stretched(travel, stretch, presliding),)

'''

_PRESLIDING = """
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which friction turns round', logarithmic=True
        ),"""


def draft_effect(identification: Identification, name: str) -> str:
    """
    Return the text of an effect's file, of the first law that was drawn and has a formula.

    Raises
    ------
    InputError
        If none was, or the law depends on what an effect of this form can't.

    """
    for result in identification.closed:
        law = result.findings.unknown
        if law is not None and law.formulas and VARIABLES[law.against].effect:
            return _drafted(law, name, result)
    raise InputError('no effect is drafted: no law was drawn that has a formula in what it depends on')


def _drafted(law: Characteristic, name: str, result: ChannelResult) -> str:
    formula = law.formulas[0]
    functions_of_place, variable = PLACES[law.enters].effect, VARIABLES[law.against].effect
    names = [_NUMBERS[letter][0] for letter in formula.numbers]
    values = [f'{value:.6g}' for value in formula.numbers.values()]
    written = formula.code + ''.join(function.result for function in functions_of_place)
    used = [one for one in ('exp', 'tanh', 'wave') if f'{one}(' in written]
    imports = ['from cfd_pneumatic.model.kernels import inlined']
    if used:
        imports.append(f'from cfd_pneumatic.model.lanewise import {", ".join(used)}')
    own, more, last = names, '', ''
    if functions_of_place[0].name != 'force':
        more = '    moves_rest=True,\n'
    elif law.against == 'p':
        variable = _BOTH_PRESSURES
    if law.enters == 'friction':
        imports.insert(0, 'from cfd_pneumatic.model.effects.seal_friction import stretched')
        own, more = ['stretch', *names, 'presliding'], "    states=1,\n    follows='motion',\n"
        presliding = result.found.model.effects[result.channel.curve.name][2]
        values.append(f'{presliding:.6g}')
        last = _PRESLIDING
    units = {'a': _unit_of_height(law, formula.power)}
    parameters = '\n'.join(_parameter(letter, units.get(letter, law.unit_against), law) for letter in formula.numbers)
    functions = [
        _FUNCTION.format(
            function=function.name,
            taken=function.argument,
            parameters=', '.join(own),
            names=', '.join(names),
            letters=', '.join(formula.numbers),
            what=function.returned,
            variable=variable,
            result=function.result.format(f'({formula.code})'),
        )
        for function in functions_of_place
    ]
    if law.enters == 'friction':
        functions.append(_SLIDE.format(parameters=', '.join(own)))
    return _FILE.format(
        title=name.replace('_', ' ').capitalize(),
        words=law.description.partition('. Inspect')[0],
        imports=''.join(f'{one}\n' for one in imports),
        functions=''.join(functions),
        where=result.name,
        found=f'({", ".join(values)},)',
        otherwise=f'({", ".join([_turned(values[0]), *values[1:]])},)',
        name=name,
        parameters=parameters + last,
        against=VARIABLES[law.against].seen_against,
        more=more,
    )


def _unit_of_height(law: Characteristic, power: int) -> str:
    """Return the unit of what is multiplied with a power of what the law depends on."""
    own, against = '-' if law.unit == '1' else law.unit, law.unit_against
    if power and own == against:
        own, power = '-', power - 1
    if not power:
        return own
    per = against if power == 1 else f'{against}^{power}'
    return f'{"1" if own == "-" else own}/{per}'


def _turned(value: str) -> str:
    return value.removeprefix('-') if value.startswith('-') else f'-{value}'


def _parameter(letter: str, unit: str, law: Characteristic) -> str:
    name, description = _NUMBERS[letter]
    lower = '1e-9' if letter == 'c' else '-1e9'
    null = '1.0' if letter == 'c' else '0.0'
    more = ', logarithmic=True' if letter == 'c' else ''
    if law.against == 'x' and letter in 'bc':
        more += f", on_stroke='{name}'"
    return f"        EffectParameter('{name}', '{unit}', {lower}, 1e9, {null}, '{description}'{more}),"
