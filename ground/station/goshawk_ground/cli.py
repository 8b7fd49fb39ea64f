"""The `goshawk` command line. Exit status: 0 done, 1 refused or failed, 2 no reply or wrong usage."""

from __future__ import annotations

import typer

from goshawk_ground.commands import doctor, flight, keys_transfer, logs, pages, trainer

app = typer.Typer(
    name="goshawk",
    help="Start, stop, watch and review a Goshawk vehicle.",
    epilog="Typical: goshawk ground, then open the printed address; or goshawk demo, which needs no vehicle.",
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
)

flight.register(app)
pages.register(app)
logs.register(app)
doctor.register(app)
keys_transfer.register(app)
trainer.register(app)


def main() -> None:
    """Entry point."""
    app(prog_name="goshawk", obj=trainer.restart_with)
