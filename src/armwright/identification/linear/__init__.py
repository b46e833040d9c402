"""Black-box models of one input and one output, or several: ARX, OE, ARMAX, subspace, frequency response."""
