(Ten millimetres each of X and Y, engraved)
G21 G91
G1 Z-1 F1500
X10 Y10
Z1
M2
