(A shoulder of 26 mm, 5 mm long. The tool stands at the face, two slots clear of a bar of 28 mm.)
G10 L20 P1 X14.3556 Z0
G18 G21 G90
M3 S600
G0 X13 Z1
G1 Z-5 F200
G0 X14.3556
G0 Z0
M5
