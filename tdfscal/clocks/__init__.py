"""Clocks of recorders that ran apart: how far one is from the other, by what both have seen.

Positions show when the terminal moves; the forces change then too, and balance at every instant
(theory, section 15). The moves name the lags that may be; the balance tells them apart.
"""
