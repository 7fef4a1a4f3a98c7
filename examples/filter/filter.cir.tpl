* Low-pass filter of Sallen and Key, both capacitors from one reel
.param c = {<capacitor> + <shift>}
V1 in 0 DC 0 AC 1
R1 in a 10k
R2 a b 10k
C1 a out {2.2n * c}
C2 b 0 {1.0n * c}
E1 out 0 b out 1e5
.ac dec 200 1k 100k
.save v(out)
.meas ac cutoff when vdb(out) = -3 fall = 1
.end
