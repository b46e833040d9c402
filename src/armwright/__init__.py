"""Robot arms with their motors: models, compiled dynamics, sampled simulation, identification, motion and control.

import armwright as aw

arm = aw.load("cmu-dd")
dyn = aw.compile(arm)
tau = dyn.inverse_dynamics(q, qd, qdd)
"""

from armwright.lazy import lazy_names

__version__ = "0.2.0"
__getattr__, __dir__, __all__ = lazy_names(__name__)
