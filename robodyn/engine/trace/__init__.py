"""From arrays of symbols to programs: what was computed, folded, ordered, and where each number lies.

graph       traced scalars, and the operations that they leave behind
program     the graph made ready for a machine: ordered, multiply-adds fused
sweeps      records a step per kind of node of a forest; `recording`: what it writes down; `alike`: expressions worth a loop
layout      finds places for what was recorded: a program with loops
"""
