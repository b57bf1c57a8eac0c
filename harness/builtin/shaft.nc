(A stepped shaft, turned from bar stock: three diameters, ending 40, 26 and 12 mm from the face.)
(The shaft of shaft.ngc for a controller of the kind of GRBL: X is a radius.)
G21 G18 G90 G40 G94
S1500 M3
(rough the first diameter)
G1 X13.55 F310
G1 Z-40
G0 X13.75
G0 Z0
(rough the second one)
G1 X13
G1 Z-26
G0 X13.2
G0 Z0
G1 X12.475
G1 Z-26
G0 X12.675
G0 Z0
(rough the third one)
S2000 F265
G1 X11.95
G1 Z-12
G0 X12.15
G0 Z0
G1 X11.4
G1 Z-12
G0 X11.6
G0 Z0
(finish all, from the face on)
G1 X11.23 F178
G1 Z-12
G1 X12.15
G1 Z-26
G1 X13.39
G1 Z-40
G1 X14.28
(back to the face)
G0 Z0
M2
