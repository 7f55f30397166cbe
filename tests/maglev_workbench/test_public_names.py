"""The public names of the packages: listed by `dir`, typed for editors, and loaded from their homes."""

import ast
import inspect
import re
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path

import pytest

import maglev_workbench


@pytest.mark.parametrize("name", ["maglev_env", "sim2real"])
def test_what_editors_see_is_what_loads(name):
    package = import_module(name)
    tree = ast.parse(Path(package.__file__).read_text())
    typed = next(node for node in tree.body if isinstance(node, ast.If))
    seen = {alias.name: node.module for node in typed.body if isinstance(node, ast.ImportFrom) for alias in node.names}
    assert seen == {name_: f"{name}.{home}" for name_, home in package._HOME.items()}
    assert dir(package) == package.__all__ == sorted(seen)
    for one, home in seen.items():
        assert getattr(package, one) is getattr(import_module(home), one)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = package.nothing


def test_the_workbench_shows_them_all():
    import maglev_env
    import sim2real

    assert set(dir(maglev_workbench)) == {"__version__", *maglev_env.__all__, *sim2real.__all__}
    assert all(getattr(maglev_workbench, name) is not None for name in dir(maglev_workbench))
    assert maglev_workbench.load_rig is maglev_env.load_rig and maglev_workbench.diagnose is sim2real.diagnose
    assert maglev_workbench.__version__.count(".") >= 1
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = maglev_workbench.nothing


PUBLIC = [name for name in dir(maglev_workbench) if name not in ("__version__", "EFFECTS")]


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_name_says_what_it_takes(name):
    """Every parameter and field stands in the docstring, or has its unit and range beside it; so do public methods."""
    one = getattr(maglev_workbench, name)
    text = inspect.getdoc(one) or ""
    assert text.partition("\n")[0].endswith((".", ";", ",")) or "\n" in text
    of_fields = {f.name for f in fields(one) if f.metadata} if is_dataclass(one) else set()
    own = [p for p in inspect.signature(one).parameters.values() if p.kind is not p.VAR_KEYWORD]
    missing = [p.name for p in own if p.name not in of_fields and not re.search(rf"\b{p.name}\b", text)]
    assert not missing, f"{name}: its docstring does not say what {', '.join(missing)} is"
    if inspect.isclass(one):
        home = one.__module__.partition(".")[0]
        for attribute, value in vars(one).items():
            if callable(value) and not attribute.startswith("_") and getattr(value, "__module__", "").startswith(home):
                assert inspect.getdoc(value), f"{name}.{attribute} has no docstring"
    elif "raise " in inspect.getsource(one):
        assert "Raises:" in text, f"{name}: its docstring does not say which errors it raises"


@pytest.mark.parametrize("name", PUBLIC)
def test_a_public_function_is_typed(name):
    one = getattr(maglev_workbench, name)
    if inspect.isclass(one):
        return
    signature = inspect.signature(one)
    assert signature.return_annotation is not signature.empty
    assert all(p.annotation is not p.empty for p in signature.parameters.values())
