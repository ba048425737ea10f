# SPDX-License-Identifier: BSD-3-Clause
"""The benchmark in rows of text: recordings by estimators, all figures, costs, impacts, and what failed."""

from collections.abc import Iterator

from coclo_vio.experiments.legged.legged_record import LeggedRecord, LeggedRow

_FIGURES = (
    ("drift_percent", "drift [%]", "{:.2f}"),
    ("rpe_1m_percent", "RPE [%]", "{:.2f}"),
    ("ate_m", "ATE [m]", "{:.3f}"),
    ("ate_planar_m", "planar ATE [m]", "{:.3f}"),
    ("path_ratio", "path ratio", "{:.3f}"),
    ("yaw_drift_deg", "yaw [deg]", "{:.2f}"),
    ("anees_pose", "ANEES", "{:.2f}"),
    ("anees_1m", "ANEES over 1 m", "{:.2f}"),
)
DETAIL_HEAD = ("recording", "estimator", "runs", "failed", *(title for _, title, _ in _FIGURES), "ms")
"""Titles of ``detail_rows``."""
IMPACT_HEAD = ("recording", "std, 99 % [m/s^2]", "coclo", "inekf", "inekf over coclo, drift / RPE")
"""Titles of ``impact_rows``."""


def overview_head(record: LeggedRecord) -> tuple[str, ...]:
    """Titles of ``overview_rows``."""
    return ("recording", *(f"`{name}`" for name in _names(record)))


def overview_rows(record: LeggedRecord) -> Iterator[tuple[str, ...]]:
    """A row a recording: drift / RPE in percent, ANEES of each estimator, the least drift bold; then the costs."""
    names = _names(record)
    for group, rows in _by_group(record).items():
        drifts = [row.figures.drift_percent for row in rows.values() if row.figures.drift_percent is not None]
        yield (group, *(_cell(rows.get(name), min(drifts, default=None)) for name in names))
    yield ("ms a joint sample", *(_cost(record, name) for name in names))


def detail_rows(record: LeggedRecord) -> Iterator[tuple[str, ...]]:
    """A row for each recording and estimator, with every figure."""
    for row in record.rows:
        figures = (_number(getattr(row.figures, key), form) for key, _, form in _FIGURES)
        cost = _number(row.cpu_ms_per_joint_sample, "{:.2f}")
        yield (row.group, f"`{row.trajectory}`", str(row.runs), str(row.failures), *figures, cost)


def impact_rows(record: LeggedRecord) -> Iterator[tuple[str, ...]]:
    """A row for each recording whose impacts were varied and that both estimators ran on, softest first."""
    for rows in impact_pairs(record):
        ours, theirs = rows
        strength = ours.impacts
        measured = "-" if strength is None else f"{strength.std_mps2:.1f}, {strength.peak_mps2:.1f}"
        quotients = (
            _quotient(getattr(theirs.figures, key), getattr(ours.figures, key))
            for key in ("drift_percent", "rpe_1m_percent")
        )
        yield (ours.group, measured, _cell(ours, None), _cell(theirs, None), " / ".join(quotients))


def impact_pairs(record: LeggedRecord) -> list[tuple[LeggedRow, LeggedRow]]:
    """``coclo`` and ``inekf`` on each recording whose impacts were varied, in the order of the impacts."""
    pairs = []
    for rows in _by_group(record, impacts=True).values():
        ours, theirs = rows.get("coclo"), rows.get("inekf")
        if ours is not None and theirs is not None and ours.impacts is not None:
            pairs.append((ours.impacts.peak_mps2, ours, theirs))
    return [(ours, theirs) for _, ours, theirs in sorted(pairs, key=lambda pair: pair[0])]


def failure_lines(record: LeggedRecord) -> list[str]:
    """Sentences on runs that failed and recordings that could not be made; empty without any."""
    failed = [
        f"* {row.group}, `{row.trajectory}`, {row.failures} of {row.runs} failed: {' '.join(row.reasons)}"
        for row in record.rows
        if row.failures
    ]
    return [*failed, *(f"* {name} was not recorded: {reason}" for name, reason in record.not_recorded.items())]


def _by_group(record: LeggedRecord, *, impacts: bool = False) -> dict[str, dict[str, LeggedRow]]:
    groups: dict[str, dict[str, LeggedRow]] = {}
    for row in record.rows:
        if (row.kind == "impacts") == impacts:
            groups.setdefault(row.group, {})[row.trajectory] = row
    return groups


def _names(record: LeggedRecord) -> list[str]:
    return list(dict.fromkeys(row.trajectory for row in record.rows if row.kind != "impacts"))


def _cell(row: LeggedRow | None, least_drift: float | None) -> str:
    if row is None:
        return ""
    figures = row.figures
    drift = _number(figures.drift_percent, "{:.2f}")
    if least_drift is not None and figures.drift_percent == least_drift:
        drift = f"**{drift}**"
    failed = f" ({row.failures} of {row.runs} failed)" if row.failures else ""
    anees = "" if figures.anees_pose is None else f", {figures.anees_pose:.2f}"
    return f"{drift} / {_number(figures.rpe_1m_percent, '{:.2f}')}{anees}{failed}"


def _cost(record: LeggedRecord, name: str) -> str:
    costs = sorted(
        row.cpu_ms_per_joint_sample
        for row in record.rows
        if row.trajectory == name and row.kind != "impacts" and row.cpu_ms_per_joint_sample is not None
    )
    return f"{costs[len(costs) // 2]:.2f}" if costs else "-"


def _quotient(above: float | None, below: float | None) -> str:
    return "-" if above is None or not below else f"{above / below:.2f}"


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else form.format(value)
