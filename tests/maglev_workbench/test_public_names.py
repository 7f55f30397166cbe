"""The public names of the packages: listed by `dir`, typed for editors, and loaded from their homes."""

import ast
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
