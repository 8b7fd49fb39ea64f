"""Questions to flown campaigns, in SQL by DuckDB: each flight is a row of `flights`."""

from __future__ import annotations

from typing import Any

import duckdb

from goshawk_train.cluster import table
from goshawk_train.cluster.store import Store, StoreError
from goshawk_train.errors import TrainerError
from goshawk_train.rates import Rate

RATES = """
select row, pilot, speed_mps, world, spacing_m, count(*) as flights, count(*) filter (success) as successes,
       count(*) filter (outcome = 'collision') as collisions, sum(core_s) as core_s
from flights group by grouping sets ((row, cell, pilot, speed_mps, world, spacing_m), ())
order by row nulls last, cell
"""
"""Each cell's, in the order of the table, then those of all flights, whose row is null."""


class QueryError(TrainerError):
    """The question cannot be answered; the message is DuckDB's."""


def flights(store: Store) -> Any:
    """The campaign's flights; raises `StoreError`."""
    if not store.has("flights.parquet"):
        raise StoreError(f"{store.address} holds no finished campaign: goshawk campaign run PLAN --out {store.address}")
    return table.read(store, "flights.parquet")


def ask(store: Store, question: str) -> Any:
    """DuckDB's answer; raises `QueryError`."""
    connection = duckdb.connect()
    connection.register("flights", flights(store))
    asked = " ".join(question.split())
    try:
        answer: Any = connection.sql(question)
        if answer is not None:
            return answer.materialize()  # now: what is wrong with a row is found when it is read
    except duckdb.Error as error:
        raise QueryError(f"{asked}: {str(error).splitlines()[0]}") from error
    raise QueryError(f"{asked}: this asks nothing; a question begins with select, summarize or describe")


def summary(store: Store) -> str:
    """Each cell's success and collision rates with their exact intervals, then those of all flights."""
    lines: list[str] = []
    for row, pilot, speed_mps, world, spacing_m, count, successes, collisions, core_s in ask(store, RATES).fetchall():
        place = "" if row is None else f", {speed_mps:g} m/s, {f'{spacing_m:g} m' if world == 'forest' else world}"
        who = "" if pilot in (None, "policy") else f", {pilot}"
        success, collision = (Rate(count=some, flights=count) for some in (successes, collisions))
        lines.append(
            f"{row or 'all'}{place}{who}: {count} flights, success {success}, collision {collision}, "
            f"{count / core_s * 3600:.0f} flights per core-hour"
        )
    return "\n".join(lines)
