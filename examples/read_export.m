% Reads what `microvib export` writes, in MATLAB or Octave:
%
%   microvib export state-1 --as mat -o run.mat
%   microvib export state-1 --as state-space -o drive.mat

run = load("run.mat");
[amplitude, order] = sort(abs(run.lines.phasor(:, 1)), "descend");
fprintf("largest lines of %s [%s]\n", run.lines.channel_names{1}, run.lines.channel_units{1});
for k = 1:3
  n = order(k);
  fprintf("  %-14s %9.4f Hz  %.4g\n", run.lines.names{n}, run.lines.frequency(n), amplitude(k));
end

drive = load("drive.mat");
y = find(strcmp(drive.output_names, "T_d"));
u = find(strcmp(drive.input_names, "output_torque"));
s = 2i * pi * 10;
G = drive.C(y, :) * ((s * eye(size(drive.A, 1)) - drive.A) \ drive.B(:, u)) + drive.D(y, u);
fprintf("T_d over a torque on the output at 10 Hz: %.6f, %.2f deg\n", abs(G), angle(G) * 180 / pi);
