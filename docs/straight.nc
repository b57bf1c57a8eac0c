(A hundred millimetres, as fast as X can)
G21 G91
G0 X100
M2
