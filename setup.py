"""What pyproject.toml cannot say: the resource folders stand beside the package in a checkout, and
the wheel carries them inside it, where `pirlc.resources` finds them.
"""

from setuptools import find_packages, setup

RESOURCES = {f"pirlc._resources.{name}": name for name in ("grammars", "templates", "runtime")}
KINDS = ["**/*.lark", "**/*.j2", "**/*.css", "**/*.[ch]", "**/*.cpp", "**/*.py"]

setup(
    packages=[*find_packages(include=["pirlc", "pirlc.*"]), *RESOURCES],
    package_dir=RESOURCES,
    package_data={
        "pirlc": ["py.typed", "explanations/*.md"],
        **dict.fromkeys(RESOURCES, KINDS),
    },
    include_package_data=False,
)
