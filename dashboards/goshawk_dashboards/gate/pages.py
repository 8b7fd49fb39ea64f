"""The gate's own pages: plain, without scripts, one thing to do on each."""

from __future__ import annotations

from html import escape

_STYLE = (
    "body{font:17px/1.5 system-ui,sans-serif;background:#11141a;color:#e8eaed;max-width:34em;margin:14vh auto;"
    "padding:0 1em}h1{font-size:1.3em}input,button{font:inherit;padding:.45em .8em;border-radius:6px;border:1px solid"
    " #5a6270;background:#1b2029;color:inherit}button{background:#2b5f9e;border-color:#2b5f9e;cursor:pointer}"
    "code{background:#1b2029;padding:.1em .3em}p.bad{color:#ff8a80}a{color:#8ab4f8}"
)


def _page(title: str, body: str, head: str = "") -> str:
    return (
        f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{escape(title)}</title>'
        f'<meta name="viewport" content="width=device-width,initial-scale=1"><link rel="icon" href="data:,">'
        f"<style>{_STYLE}</style>{head}</head><body><h1>{escape(title)}</h1>{body}</body></html>"
    )


def refused(title: str, what_to_do: str) -> str:
    """A refusal, and what to do."""
    return _page(title, f'<p data-gate="refused">{escape(what_to_do)}</p>')


def opening() -> str:
    """Goes on to the dashboard without the token.

    It is a page and not a redirection: to a page that was reached from elsewhere, a browser would not show the cookie
    that it has just been given.
    """
    go_on = '<meta http-equiv="refresh" content="0;url=./">'
    return _page("Opening the dashboard", '<p><a href="./">Open it</a></p>', go_on)


def sign_in(*, wrong: str = "", with_password: bool) -> str:
    """Asks for the link, and for a password where there are any."""
    first = "The ground station printed the password, unless it was given one. Or open" if with_password else "Open"
    link = (
        f"<p>{first} the link that the ground station printed when it started. It ends in"
        ' <code style="white-space:nowrap">?token=…</code> and lets this browser in for a day.</p>'
    )
    if not with_password:
        return _page("This dashboard needs its link", f'<div data-gate="sign-in">{link}</div>')
    trouble = f'<p class="bad" data-gate="trouble">{escape(wrong)}</p>' if wrong else ""
    form = (
        '<form method="post" action="login" data-gate="login"><p><label>Password '
        '<input type="password" name="password" autocomplete="current-password" required autofocus></label> '
        "<button>Log in</button></p></form>"
    )
    return _page("Log in to the dashboard", f'<div data-gate="sign-in">{trouble}{form}{link}</div>')
