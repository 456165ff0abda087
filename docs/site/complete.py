"""The reference is complete: the build warns, and so fails, of every public name that it lacks."""

from __future__ import annotations

import importlib
import inspect
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator

import cpp_reference
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging

import rotavg

logger = logging.getLogger(__name__)

MODULES = ("rotavg", *(f"rotavg.{name}" for name in sorted({*dir(rotavg)} - {*rotavg.__all__})))
NEEDLESS = {"rotavg.__version__"}  # said in docs/stability.md


def python_names() -> Iterator[tuple[str, ...]]:
    """Every public name of Python, with the names under which it may stand instead."""
    first: dict[int, str] = {}
    for module_name in MODULES:
        module = importlib.import_module(module_name)
        for name in module.__all__:
            value = getattr(module, name)
            full = f"{module_name}.{name}"
            if full in NEEDLESS or inspect.ismodule(value):
                continue
            known = first.setdefault(id(value), full)
            yield full, known
            if inspect.isclass(value) and known == full and not issubclass(value, Exception):
                fields = getattr(
                    value, "__dataclass_fields__", ()
                )  # the class's docstring has them
                for attribute, found in vars(value).items():
                    if not (attribute.startswith("_") or attribute in fields) and (
                        callable(found) or isinstance(found, (property, classmethod, staticmethod))
                    ):
                        yield (f"{full}.{attribute}",)


def cpp_names() -> set[str]:
    """Every public name of C++ that Doxygen found in a header."""
    names: set[str] = set()
    for entry in ET.parse(cpp_reference.XML / "index.xml").getroot().findall("compound"):
        if entry.attrib["kind"] not in ("class", "struct", "namespace"):
            continue
        element = cpp_reference.compound(entry.attrib["refid"])
        scope = cpp_reference.text_of(element.find("compoundname"))
        if element.get("prot", "public") != "public" or not (
            scope == "rotavg" or cpp_reference.public(scope)
        ):
            continue
        if entry.attrib["kind"] != "namespace":
            names.add(scope)
        for found in element.iter("memberdef"):
            name = cpp_reference.text_of(found.find("name"))
            if found.attrib["prot"] == "public" and found.attrib["kind"] in cpp_reference.KINDS:
                names.add(f"{scope}::{name}")
    return {re.sub(r"<.*", "", name) for name in names if "@" not in name}


def check(app: Sphinx, env: BuildEnvironment) -> None:
    """Compare what there is with what the pages hold."""
    told = {name for name, *_ in env.get_domain("py").get_objects()}
    for names in python_names():
        if not told & set(names):
            logger.warning("the Python reference lacks %s", names[0], type="complete")
    told = {re.sub(r"<.*", "", name) for name, *_ in env.get_domain("cpp").get_objects()}
    for name in sorted(cpp_names() - told):
        logger.warning("the C++ reference lacks %s", name, type="complete")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register with Sphinx."""
    app.connect("env-check-consistency", check)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
