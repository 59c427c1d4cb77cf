# SPDX-License-Identifier: Apache-2.0
"""A draft of an effect's file from an estimated curve with a formula; next steps: `docs/how_to/add_an_effect.md`."""

from __future__ import annotations

from cfd_pneumatic.errors import InputError
from cfd_pneumatic.identification import PLACES, VARIABLES, ChannelResult, Characteristic, Identification

_BOTH_PRESSURES = 'moment.p - moment.ambient + moment.opposing - moment.ambient'
"""Expression of the pressure for a curve that changes the force."""

_PARAMETERS = {
    'a': ('height', 'strength of the effect'),
    'b': ('place', 'centre of the curve'),
    'c': ('length', 'width of the curve'),
}

_FILE = '''"""{title}: {description}."""

from __future__ import annotations

from cfd_pneumatic.model.effects.effect import Data, Effect, EffectParameter
{imports}
{functions}
def starts(data: Data) -> list[tuple[float, ...]]:
    """Return the values estimated for {channel}, and the same values with the opposite sign of the height."""
    return [{estimated}, {opposite}]


EFFECT = Effect(
    name='{name}',
    description='{description}',
    inspect='{inspect}',
    parameters=(
{parameters}
    ),
    equations=(),
    starts=starts,
    shown_by='a motion like that in the recording that showed the effect',
    seen_against='{against}',
{more})
'''

_FUNCTION = '''
@inlined
def {function}({argument}, moment, {parameters}):
    """Return {returned}."""
    z = {variable}
    {letters} = {names}
    return {result}

'''

_SLIDE = '''
@inlined
def slide(travel, {parameters}):
    """Return the friction as a share of its full value, -1 to 1."""
    return (stretched(travel, stretch, presliding),)

'''

_PRESLIDING = """
        EffectParameter(
            'presliding', 'm', 1e-6, 1e-2, 1e-4, 'displacement over which the friction reverses', logarithmic=True
        ),"""


def draft_effect(identification: Identification, name: str) -> str:
    """
    Return the text of an effect's file for the first estimated curve with a formula.

    Raises
    ------
    InputError
        If no curve has a formula, or an effect cannot depend on the variable of the curve.

    """
    for result in identification.closed:
        curve = result.findings.unknown
        if curve is not None and curve.formulas and VARIABLES[curve.against].effect:
            return _file_text(curve, name, result)
    raise InputError(
        'no effect is drafted: no estimated curve has a formula that an effect can use. Omit --draft-effect'
    )


def _file_text(curve: Characteristic, name: str, result: ChannelResult) -> str:
    formula = curve.formulas[0]
    functions_of_place, variable = PLACES[curve.enters].effect, VARIABLES[curve.against].effect
    names = [_PARAMETERS[letter][0] for letter in formula.numbers]
    values = [f'{value:.6g}' for value in formula.numbers.values()]
    code = formula.code + ''.join(function.result for function in functions_of_place)
    used = [called for called in ('exp', 'tanh', 'wave') if f'{called}(' in code]
    imports = ['from cfd_pneumatic.model.kernels import inlined']
    if used:
        imports.append(f'from cfd_pneumatic.model.lanewise import {", ".join(used)}')
    arguments, more_fields, last_parameter = names, '', ''
    if functions_of_place[0].name != 'force':
        more_fields = '    moves_rest=True,\n'
    elif curve.against == 'p':
        variable = _BOTH_PRESSURES
    if curve.enters == 'friction':
        imports.insert(0, 'from cfd_pneumatic.model.effects.seal_friction import stretched')
        arguments, more_fields = ['stretch', *names, 'presliding'], "    states=1,\n    follows='motion',\n"
        presliding = result.found.model.effects[result.channel.curve.name][2]
        values.append(f'{presliding:.6g}')
        last_parameter = _PRESLIDING
    units = {'a': _unit_of_height(curve, formula.power)}
    parameters = '\n'.join(
        _parameter(letter, units.get(letter, curve.unit_against), curve) for letter in formula.numbers
    )
    functions = [
        _FUNCTION.format(
            function=function.name,
            argument=function.argument,
            parameters=', '.join(arguments),
            names=', '.join(names),
            letters=', '.join(formula.numbers),
            returned=function.returned,
            variable=variable,
            result=function.result.format(f'({formula.code})'),
        )
        for function in functions_of_place
    ]
    if curve.enters == 'friction':
        functions.append(_SLIDE.format(parameters=', '.join(arguments)))
    return _FILE.format(
        title=name.replace('_', ' ').capitalize(),
        description=curve.cause,
        inspect=PLACES[curve.enters].inspect,
        imports=''.join(f'{line}\n' for line in imports),
        functions=''.join(functions),
        channel=result.name,
        estimated=f'({", ".join(values)},)',
        opposite=f'({", ".join([_negated(values[0]), *values[1:]])},)',
        name=name,
        parameters=parameters + last_parameter,
        against=VARIABLES[curve.against].seen_against,
        more=more_fields,
    )


def _unit_of_height(curve: Characteristic, power: int) -> str:
    """Return the unit of a factor that multiplies a power of the curve's variable."""
    unit, against = '-' if curve.unit == '1' else curve.unit, curve.unit_against
    if power and unit == against:
        unit, power = '-', power - 1
    if not power:
        return unit
    per = against if power == 1 else f'{against}^{power}'
    return f'{"1" if unit == "-" else unit}/{per}'


def _negated(value: str) -> str:
    return value.removeprefix('-') if value.startswith('-') else f'-{value}'


def _parameter(letter: str, unit: str, curve: Characteristic) -> str:
    name, description = _PARAMETERS[letter]
    lower = '1e-9' if letter == 'c' else '-1e9'
    null = '1.0' if letter == 'c' else '0.0'
    keywords = ', logarithmic=True' if letter == 'c' else ''
    if curve.against == 'x' and letter in 'bc':
        keywords += f", on_stroke='{name}'"
    return f"        EffectParameter('{name}', '{unit}', {lower}, 1e9, {null}, '{description}'{keywords}),"
