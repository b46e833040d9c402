"""What the session cites, in full: the entries of `docs/references.md` that its variables and commands name."""

from __future__ import annotations

import re

REPORT = "CMU report"  # as the pages of help call [SwartzReport]
KEY = re.compile(r"\[([A-Z]\w*)\]")

SOURCES = {
    "SwartzReport": "N. M. Swartz. Arm Dynamics Simulation. Carnegie-Mellon University, Robotics Institute; "
    "dated 23 November 1982",
    "AstromHagglund2006": "K. J. Åström, T. Hägglund. Advanced PID Control. ISA, 2006.",
    "DenavitHartenberg1955": "J. Denavit, R. S. Hartenberg. A kinematic notation for lower-pair mechanisms based on matrices. "
    "ASME Journal of Applied Mechanics 22(2), 215–221, 1955.",
    "Featherstone2008": "R. Featherstone. Rigid Body Dynamics Algorithms. Springer, 2008.",
    "Kutta1901": "W. Kutta. Beitrag zur näherungsweisen Integration totaler Differentialgleichungen. "
    "Zeitschrift für Mathematik und Physik 46, 435–453, 1901.",
    "LuhWalkerPaul1980": "J. Y. S. Luh, M. W. Walker, R. P. C. Paul. On-line computational scheme for mechanical manipulators. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 102(2), 69–76, 1980.",
    "SicilianoEtAl2009": "B. Siciliano, L. Sciavicco, L. Villani, G. Oriolo. Robotics: Modelling, Planning and Control. "
    "Springer, 2009.",
    "Symon1971": "K. R. Symon. Mechanics, third edition. Addison-Wesley, 1971.",
    "WalkerOrin1982": "M. W. Walker, D. E. Orin. Efficient dynamic computer simulation of robotic mechanisms. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 104(3), 205–211, 1982.",
    "Whitney1972": "D. E. Whitney. The mathematics of coordinated control of prosthetic arms and manipulators. "
    "ASME Journal of Dynamic Systems, Measurement, and Control 94(4), 303–309, 1972.",
}
"""Key → the entry, without marks of Markdown."""


def cited(source: str) -> list[str]:
    """The works that a source names, one a line: `CMU report: N. M. Swartz. …`, `[Kutta1901]: W. Kutta. …`."""
    keys = [key for key in KEY.findall(source) if key in SOURCES]
    told = [f"[{key}]: {SOURCES[key]}" for key in dict.fromkeys(keys)]
    return [f"{REPORT}: {SOURCES['SwartzReport']}"] * (REPORT in source) + told
