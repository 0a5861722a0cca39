"""Write config/params.yaml and the table in doc/parameters.md from the declared parameters."""

from __future__ import annotations

from pathlib import Path

from horizon_sensor_ros.ros.parameters.reference import parameter_file, parameter_reference

ROOT = Path(__file__).parents[1]
BEGIN, END = "<!-- written by make params -->\n", "<!-- end -->\n"


def parameter_page(page: str) -> str:
    """Return the page with the table between its marks written anew."""
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return f"{before}{BEGIN}\n{parameter_reference()}\n{END}{after}"


def main() -> None:
    """Write both."""
    (ROOT / "config" / "params.yaml").write_text(parameter_file(), encoding="utf-8")
    page = ROOT / "doc" / "parameters.md"
    page.write_text(parameter_page(page.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main()
