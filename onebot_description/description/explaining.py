"""Turning what xacro raises into a message with place, cause and remedy."""

import re
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

from onebot_description.description.reading import missing_file, shown_path
from onebot_description.errors import OneBotError
from onebot_description.text import did_you_mean


def explain(error: Exception, path: Path, arguments: Iterable[str]) -> str:
    """Return the message for what xacro raised while it processed ``path``.

    Args:
        error: what was raised.
        path: the file xacro was started on.
        arguments: the names of the arguments the files declare.
    """
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)]
    places = [place for frame in frames if (place := _place(frame)) is not None]
    place = places[-1] if places else shown_path(path)
    return f"{place}: {_cause(_chain(error), frames, list(arguments))}"


def _chain(error: Exception) -> list[Exception]:
    """The exceptions that xacro wrapped into each other, outermost first."""
    chain = [error]
    while isinstance(inner := getattr(chain[-1], "exc", None), Exception):
        chain.append(inner)
    return chain


def _cause(chain: list[Exception], frames: list[FrameType], arguments: list[str]) -> str:
    """The sentence without its place."""
    inner = chain[-1]
    expression = _expression(chain)
    if isinstance(inner, OneBotError):
        return str(inner)
    if isinstance(inner, RecursionError):
        return f"{_recursing(frames)} calls itself without end"
    if isinstance(inner, FileNotFoundError) and inner.filename:
        return missing_file(Path(str(inner.filename)))
    if isinstance(inner, NameError) and (name := re.search(r"name '(.+?)'", str(inner))):
        hint = did_you_mean(name[1], _names(frames, "symbols"), "defined")
        return f'unknown property "{name[1]}" in ${{{expression}}}{hint}'
    if type(inner).__name__ == "ArgException":
        hint = did_you_mean(str(inner), arguments, "declared")
        return (
            f'argument "{inner}" has no value{hint}; give {inner}:=<value>, '
            f'or declare <xacro:arg name="{inner}" default="..."/>'
        )
    text = " ".join(str(inner).split()) or repr(inner)
    if unknown := re.match(r"unknown macro name: xacro:(.+)", text):
        hint = did_you_mean(unknown[1], _names(frames, "macros"), "defined")
        return f'unknown macro "{unknown[1]}"{hint}'
    if macros := getattr(inner, "macros", None):
        text = f'macro "{macros[0].body.getAttribute("name")}": {text}'
    if isinstance(inner, RuntimeError) and (
        lack := re.match(r"(.+): missing attribute (.+)", text)
    ):
        return f"<{lack[1]}> has no attribute {lack[2]}"
    if expression and not hasattr(inner, "suffix"):
        return f"cannot evaluate ${{{expression}}}: {text}"
    return f"xacro: {text}"


def _expression(chain: list[Exception]) -> str:
    """The innermost ``${...}`` that was being evaluated, "" if none."""
    for error in reversed(chain):
        if found := re.search(
            r"when evaluating expression '(.*)'", getattr(error, "suffix", None) or ""
        ):
            return found[1]
    return ""


def written_at(node: Any) -> str | None:
    """Where a DOM node was written: ``file:line``, with the macro calls that led there."""
    while node is not None:
        if places := node.getUserData("places"):
            calls = f" (called at {', from '.join(places[1:])})" if len(places) > 1 else ""
            return f"{places[0]}{calls}"
        node = node.parentNode
    return None


def _place(frame: FrameType) -> str | None:
    """Where the XML node that a frame of xacro works on was written."""
    if frame.f_globals.get("__name__") != "xacro":
        return None
    return written_at(frame.f_locals.get("node", frame.f_locals.get("elt")))


def _recursing(frames: list[FrameType]) -> str:
    """The macro that was expanded last."""
    for frame in reversed(frames):
        macro = frame.f_locals.get("m")
        if frame.f_code.co_name == "handle_macro_call" and macro is not None:
            return f'macro "{macro.body.getAttribute("name")}"'
    return "an expression"


def _names(frames: list[FrameType], table: str) -> list[str]:
    """The names in the innermost of xacro's tables of this kind (``symbols`` or ``macros``)."""
    for frame in reversed(frames):
        found = frame.f_locals.get(table)
        if isinstance(found, dict):
            return list(_own_names(found))
    return []


def _own_names(table: Any) -> Iterator[str]:
    """The names defined in the files: those of ``table`` and its parents but xacro's globals."""
    root = getattr(table, "root", None)
    while table is not None and table is not root and hasattr(table, "parent"):
        yield from (name for name in dict.keys(table) if not name.startswith(("*", "__")))
        table = table.parent
