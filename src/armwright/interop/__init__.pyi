"""The names of this room and where each lives: for type checkers, and for `armwright.lazy`."""

from armwright.interop.jax_function import jax as jax
from armwright.interop.torch_function import torch as torch
