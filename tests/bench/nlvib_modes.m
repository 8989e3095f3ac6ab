% nlvib_modes.m - NLvib's residual (folder $NLVIB) along curves of its examples 05, 06, 08 and 09, by tangents and arc length of our own
%
% One line a case: its name, CPU milliseconds a point, then triples of every point: parameter (omega, or modal amplitude), |X_1| or omega, and damping ratio or 0.
1;

function [X, J] = newton(X, residual, row, rhs)     % row' * X = rhs closes the system
  for i = 1:25
    [R, dR] = residual(X);
    J = [dR; row'];
    scale = max(abs(J), [], 2);
    step = (J ./ scale) \ ([R; row' * X - rhs] ./ scale);
    X -= step;
    if max(abs(step ./ max(abs(X), 1e-3 * max(abs(X))))) < 1e-9, return; end
  end
  X = [];
end

function points = follow(X, residual, weights, first, step, most, over)
  % weights: of the arc length; first: the sign of the last unknown's change; over(X): the curve's end
  points = zeros(numel(X), 0); row = zeros(numel(X), 1); row(end) = 1;
  [X, J] = newton(X, residual, row, X(end));
  tangent = row * first; longest = step;
  while !isempty(X) && columns(points) < most
    points(:, end + 1) = X;
    if over(X), return; end
    J(end, :) = (weights .* tangent)';
    scale = max(abs(J), [], 2);
    t = (J ./ scale) \ ([zeros(numel(X) - 1, 1); 1] ./ scale);
    tangent = t / sqrt(t' * (weights .* t));
    do
      ahead = X + step * tangent;
      [Y, K] = newton(ahead, residual, weights .* tangent, (weights .* tangent)' * ahead);
      near = !isempty(Y) && (Y - X)' * (weights .* tangent) > 0.9 * sqrt((Y - X)' * (weights .* (Y - X)));
      if !near, step /= 2; end
    until near || step < 1e-7
    if !near, return; end
    X = Y; J = K; step = min(1.3 * step, longest);
  end
end

function tell(name, begun, points, row)
  printf('%s %.6g', name, 1e3 * (cputime() - begun) / columns(points));
  for j = 1:columns(points), printf(' %.10g', row(points(:, j))); end
  printf('\n');
end

function [M, K] = cantilever(elements, length, EI, mass)   % clamped at 0
  l = length / elements; M = K = zeros(2 * (elements + 1));
  k = EI * [12, 6*l, -12, 6*l; 6*l, 4*l^2, -6*l, 2*l^2; -12, -6*l, 12, -6*l; 6*l, 2*l^2, -6*l, 4*l^2] / l^3;
  m = mass * l * [156, 22*l, 54, -13*l; 22*l, 4*l^2, 13*l, -3*l^2; 54, 13*l, 156, -22*l; -13*l, -3*l^2, -22*l, 4*l^2] / 420;
  for e = 1:elements
    at = 2 * e - 1 : 2 * e + 2;
    M(at, at) += m; K(at, at) += k;
  end
  M = M(3:end, 3:end); K = K(3:end, 3:end);
end

function element = local(type, direction, varargin)
  element = struct('type', type, 'ishysteretic', 0, 'islocal', 1, varargin{:});
  element.force_direction = direction;
end

function mode(name, system, H, N, held, from, to, step)
  n = rows(system.M);
  stiff = system.K;
  if isfield(system, 'stuck'), stiff(system.stuck, system.stuck) += 1e9 * max(diag(stiff)); end
  [shape, squares] = eig(stiff, system.M);
  [omega, order] = sort(sqrt(diag(squares))); shape = shape(:, order(1)) * sign(shape(held, order(1)));
  X = zeros((2 * H + 1) * n, 1); X(n + (1:n)) = shape; X = [X; omega(1); 0; from];
  weights = [ones((2 * H + 1) * n, 1) / (shape' * shape); 1 / omega(1) ^ 2; 1; 1];
  force = mean(abs(system.K * shape));
  begun = cputime();
  points = follow(X, @(X) HB_residual(X, system, H, N, 'NMA', held, force), weights, 1, step, 2000, @(X) X(end) > to);
  tell(name, begun, points, @(X) [10 ^ X(end), X(end - 2), X(end - 1)]);
end

function response(name, system, H, N, seen, from, to, size, step, begin)   % begin: 1 from the linear motion, 0 from rest
  n = rows(system.M);
  Q = (-from ^ 2 * system.M + 1i * from * system.D + system.K) \ system.Fex1;
  X = zeros((2 * H + 1) * n, 1); X(n + (1:2 * n)) = begin * [real(Q); -imag(Q)];
  weights = [ones((2 * H + 1) * n, 1) / size ^ 2; 1 / from ^ 2];
  begun = cputime();
  points = follow([X; from], @(X) HB_residual(X, system, H, N, 'FRF'), weights, sign(to - from), step, 4000, ...
                  @(X) (X(end) - to) * sign(to - from) > 0);
  tell(name, begun, points, @(X) [X(end), hypot(X(n + seen), X(2 * n + seen)), 0]);
end

addpath(fullfile(getenv('NLVIB'), 'SRC'));
% 05: two masses, one on a rounded friction element
system = struct('M', diag([0.02, 1]), 'D', zeros(2), 'K', [40, -40; -40, 640], 'stuck', 1);
system.nonlinear_elements = {local('tanhDryFriction', [1; 0], 'eps', 0.05, 'friction_limit_force', 5)};
mode('05', system, 21, 1024, 2, -1.5, 1, 0.1);
% 06: a mass on two springs at large deflections
a = 1.13 ^ 2; b = 4; c = (a + b) / 2;
system = struct('M', eye(2), 'D', diag([2e-3 * 1.13, 2e-2]), 'K', diag([a, b]));
system.nonlinear_elements = {struct('type', 'polynomialStiffness', 'ishysteretic', 0, 'islocal', 0, ...
  'exponents', [2 0; 1 1; 0 2; 3 0; 2 1; 1 2; 0 3], ...
  'coefficients', [1.5 * a, b / 2; b, a; a / 2, 1.5 * b; c, 0; 0, c; c, 0; 0, c])};
mode('06', system, 7, 29, 1, -3, -0.15, 0.05);
for level = [3e-4, 5e-4, 1e-3, 3e-3]
  system.Fex1 = level * [1; 1];
  response(sprintf('06_%g', level), system, 7, 29, 1, 1.6, 0.8, level / (2e-3 * 1.13 ^ 2), 0.05, 1);
end
% 08: a cantilever with rounded friction, its matrices as they are shipped
load(fullfile(getenv('NLVIB'), 'EXAMPLES', '08_beam_tanhDryFriction', 'beam.mat'), 'M', 'D', 'K', 'Fex1', 'W');
system = struct('M', M, 'D', D, 'K', K, 'Fex1', Fex1);
system.nonlinear_elements = {local('tanhDryFriction', W, 'eps', 6e-7, 'friction_limit_force', 1.5)};
response('08', system, 7, 128, rows(M) - 1, 370, 110, 1e-7, 0.1, 0);
% 09: a cantilever with a cubic spring at its end, through the tongue of its second mode
[M, K] = cantilever(19, 0.7, 2.05e11 * 0.014 ^ 4 / 12, 7800 * 0.014 ^ 2);
system = struct('M', M, 'D', 0 * M, 'K', K);
system.nonlinear_elements = {local('cubicSpring', [zeros(36, 1); 1; 0], 'stiffness', 6e9)};
mode('09', system, 5, 21, 37, -3.4, -3.3, 0.1);
