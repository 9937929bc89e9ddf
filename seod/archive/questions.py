"""Questions that are ready: each is SQL over `segments` whose headings tell the units."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any, Final

from seod.archive.engines import ArchiveError, engine
from seod.archive.sql import ask
from seod.terminal.text import number

if TYPE_CHECKING:
    import os
    from datetime import datetime

UNITS: Final = {"omega_n": "rad/s", "zeta": "", "K_L": "SI/V"}
"""Quantities of which trends are told, with the unit in a heading."""
QUANTITIES: Final = tuple(UNITS)

_OF = '($rig IS NULL OR rig = $rig) AND ($since IS NULL OR "end" >= $since)'

TREND: Final = """
WITH used AS (
  SELECT rig, axis, "begin", exciting_s, {quantity} AS value, epoch("begin") / 86400 AS days
  FROM segments WHERE quality = 'ok' AND {quantity} IS NOT NULL AND {of}
), lines AS (
  SELECT rig, axis, count(*) AS n, min("begin") AS "from", max("begin") AS "to",
    sum(exciting_s) / 3600 AS hours, avg(value) AS mean,
    regr_slope(value, days) AS slope, regr_sxx(value, days) AS sxx,
    greatest(regr_syy(value, days) - regr_slope(value, days) * regr_sxy(value, days), 0) AS rest
  FROM used GROUP BY rig, axis
), told AS (
  SELECT *, CASE WHEN n > 2 AND sxx > 0 THEN sqrt(rest / (n - 2) / sxx) END AS slope_sd FROM lines
)
SELECT rig, axis, n AS segments, "from", "to", hours AS "excited [h]", mean AS "{quantity}{unit}",
  100 * slope AS "change in 100 days{unit}", 100 * slope_sd AS "its sd{unit}",
  CASE WHEN slope_sd IS NOT NULL THEN abs(slope) > 4 * slope_sd END AS significant
FROM told ORDER BY abs(slope) / nullif(slope_sd, 0) DESC NULLS LAST, rig, axis
"""
"""A straight line through each axis' values over time; significant: four standard deviations of its slope."""

POINTS: Final = """
SELECT rig, axis, "begin", {quantity} AS value, {quantity}_sd AS sd FROM segments
WHERE quality = 'ok' AND {quantity} IS NOT NULL AND {of} ORDER BY rig, axis, "begin"
"""

LEFT_MODEL: Final = """
WITH judged AS (
  SELECT * FROM segments WHERE left_model IS NOT NULL AND ($rig IS NULL OR rig = $rig)
), held AS (
  SELECT rig, axis, max("begin") FILTER (NOT left_model) AS held FROM judged GROUP BY rig, axis
)
SELECT rig, axis, min(coalesce(left_since, "begin")) AS since, count(*) AS segments,
  arg_max(model_error, "begin") * 100 AS "model error [%]",
  arg_max(verdict, "begin") FILTER (verdict IS NOT NULL) AS verdict,
  arg_max(causes, "begin") FILTER (causes IS NOT NULL AND causes <> '[]') AS why,
  arg_max(file, "begin") AS file
FROM judged JOIN held USING (rig, axis)
WHERE left_model AND (held IS NULL OR "begin" > held)
GROUP BY rig, axis HAVING $since IS NULL OR max("end") >= $since
ORDER BY since, rig, axis
"""
"""Axes that had left their model when they were last judged; since they last kept to it."""

CAUSES: Final = """
WITH named AS (
  SELECT rig, axis, file, "begin",
    unnest(from_json(causes, '[{{"name":"VARCHAR","parameters":"JSON"}}]'), recursive := true)
  FROM segments WHERE causes IS NOT NULL AND {of}
), files AS (
  SELECT name, rig, axis, file, min("begin") AS "begin", any_value(parameters) AS parameters
  FROM named GROUP BY name, rig, axis, file
)
SELECT name AS cause, count(DISTINCT rig) AS rigs, count(*) AS recordings,
  min("begin") AS first, max("begin") AS last,
  arg_max(rig, ("begin", rig)) AS "last rig", arg_max(parameters, ("begin", rig))::VARCHAR AS "its parameters"
FROM files GROUP BY name ORDER BY rigs DESC, recordings DESC, cause
"""

COMPARE: Final = """
WITH used AS (
  SELECT rig, axis,
    CASE WHEN quality = 'ok' THEN zeta END AS zeta,
    CASE WHEN quality = 'ok' THEN omega_n END AS "omega_n [rad/s]",
    CASE WHEN quality = 'ok' THEN K_L END AS "K_L [SI/V]",
    100 * model_error AS "model error [%]",
    supply_pressure AS "supply pressure [Pa]",
    temperature AS "temperature [K]",
    e_a AS "e_a [V]"
  FROM segments
  WHERE rig IN ($rig, $other) AND ($since IS NULL OR "end" >= $since) AND exciting_s > 0
), long AS (
  UNPIVOT used ON COLUMNS(* EXCLUDE (rig, axis)) INTO NAME quantity VALUE value
), sides AS (
  SELECT axis, quantity,
    count(value) FILTER (rig = $rig) AS n1, avg(value) FILTER (rig = $rig) AS m1,
    stddev_samp(value) FILTER (rig = $rig) AS s1,
    count(value) FILTER (rig = $other) AS n2, avg(value) FILTER (rig = $other) AS m2,
    stddev_samp(value) FILTER (rig = $other) AS s2
  FROM long GROUP BY axis, quantity
)
SELECT axis, quantity, n1 AS "segments of {rig}", m1 AS "{rig}", s1 AS "sd of {rig}",
  n2 AS "segments of {other}", m2 AS "{other}", s2 AS "sd of {other}", m2 - m1 AS difference,
  (m2 - m1) / nullif(sqrt(s1 * s1 / n1 + s2 * s2 / n2), 0) AS "in its sd"
FROM sides ORDER BY axis, list_position(
  ['zeta', 'omega_n [rad/s]', 'K_L [SI/V]', 'model error [%]', 'supply pressure [Pa]', 'temperature [K]',
   'e_a [V]'],
  quantity)
"""
"""Means over segments of two rigs; their difference, also in its own standard deviations."""


def trend(where: str | os.PathLike[str], quantity: str, rig: str | None, since: datetime | None) -> Any:
    """How a quantity changes over time, an axis a row, the surest change first.

    Raises:
        ArchiveError: As of `ask`.
    """
    return ask(where, _filled(TREND, quantity), {"rig": rig, "since": since})


def points(where: str | os.PathLike[str], quantity: str, rig: str | None, since: datetime | None) -> Any:
    """What a trend goes through: rig, axis, begin, value, sd.

    Raises:
        ArchiveError: As of `ask`.
    """
    return ask(where, _filled(POINTS, quantity), {"rig": rig, "since": since})


def _filled(sql: str, quantity: str) -> str:
    unit = f" [{UNITS[quantity]}]" if UNITS[quantity] else ""
    return sql.format(quantity=quantity, unit=unit, of=_OF)


def left_model(where: str | os.PathLike[str], rig: str | None, since: datetime | None) -> Any:
    """Axes that have left their model: since when, and why as far as a diagnosis says.

    Raises:
        ArchiveError: As of `ask`.
    """
    table = ask(where, LEFT_MODEL, {"rig": rig, "since": since})
    return _in_words(table, "why")


def causes(where: str | os.PathLike[str], rig: str | None, since: datetime | None) -> Any:
    """What diagnoses have named: how many rigs, since when, and the newest one's parameters.

    Raises:
        ArchiveError: As of `ask`.
    """
    table = ask(where, CAUSES.format(of=_OF), {"rig": rig, "since": since})
    at = table.schema.get_field_index("its parameters")
    told = [_parameters(json.loads(text or "{}")) for text in table["its parameters"].to_pylist()]
    return table.set_column(at, "its parameters", engine("pyarrow").array(told, "string"))


def compare(where: str | os.PathLike[str], rig: str, other: str, since: datetime | None) -> Any:
    """Means of two rigs side by side, over segments in which they were excited.

    Raises:
        ArchiveError: As of `ask`; a rig is not in the catalogue.
    """
    known = set(ask(where, "SELECT DISTINCT rig FROM segments WHERE rig IS NOT NULL")["rig"].to_pylist())
    for name in (rig, other):
        if name not in known:
            near = ", ".join(sorted(known)[:5])
            raise ArchiveError(f"no recording of rig {name!r} is in the catalogue; there are {near} ...")
    names = {"rig": _heading(rig), "other": _heading(other if other != rig else f"{other} again")}
    return ask(where, COMPARE.format(**names), {"rig": rig, "other": other, "since": since})


def _heading(name: str) -> str:
    return name.replace('"', '""')


def _in_words(table: Any, column: str) -> Any:
    at = table.schema.get_field_index(column)
    told = [why(text) for text in table[column].to_pylist()]
    return table.set_column(at, column, engine("pyarrow").array(told, "string"))


def why(causes_json: str | None) -> str | None:
    """`coulomb_friction (level 520 N m)` of the column `causes`; None where nothing was named."""
    if not causes_json:
        return None
    told = [f"{each['name']}{_bracketed(each['parameters'])}" for each in json.loads(causes_json)]
    return ", ".join(told) or None


def _bracketed(parameters: dict[str, Any]) -> str:
    told = _parameters(parameters)
    return f" ({told})" if told else ""


def _parameters(parameters: dict[str, Any]) -> str:
    """`level 520 N m, speed 0.1 rad/s`."""
    return ", ".join(
        f"{name} {number(each.get('value'))} {each.get('unit') or ''}".rstrip()
        for name, each in parameters.items()
        if isinstance(each, dict)
    )
