% nlvib_path.m - CPU milliseconds a point of a swept response with NLvib's residual (folder $NLVIB), each point by fsolve from the last
%
% One line a case: its name, milliseconds a point, and |X_1| of the element's dof at every frequency.
1;

function [M, K] = cantilever(elements)              % EI = mass per length = length = 1, consistent mass, clamped at 0
  l = 1 / elements; n = 2 * (elements + 1);
  k = [12, 6*l, -12, 6*l; 6*l, 4*l^2, -6*l, 2*l^2; -12, -6*l, 12, -6*l; 6*l, 2*l^2, -6*l, 4*l^2] / l^3;
  m = [156, 22*l, 54, -13*l; 22*l, 4*l^2, 13*l, -3*l^2; 54, 13*l, 156, -22*l; -13*l, -3*l^2, -22*l, 4*l^2] * l / 420;
  M = K = zeros(n);
  for e = 1:elements
    at = 2 * e - 1 : 2 * e + 2;
    M(at, at) += m; K(at, at) += k;
  end
  M = M(3:end, 3:end); K = K(3:end, 3:end);
end

function [R, J] = residual(x, omega, system, H, N)
  [R, dR] = HB_residual([x; omega], system, H, N);
  J = dR(:, 1:numel(x));
end

function sweep(name, M, D, K, place, stiffness, limit, force, H, N, from, to, points)
  n = rows(M); w = zeros(n, 1); w(place) = 1;
  element = struct('type', 'elasticDryFriction', 'stiffness', stiffness, 'friction_limit_force', limit, 'ishysteretic', 1, 'islocal', 1);
  element.force_direction = w;
  system = struct('M', M, 'D', D, 'K', K, 'Fex1', force * w);
  system.nonlinear_elements = {element};
  options = optimset('Jacobian', 'on', 'Display', 'off', 'TolX', 1e-10, 'TolFun', 1e-10, 'MaxIter', 100);
  x = zeros(n * (2 * H + 1), 1); amplitude = zeros(1, points);
  omega = linspace(from, to, points);
  begun = cputime();
  for i = 1:points
    [x, ~, flag] = fsolve(@(x) residual(x, omega(i), system, H, N), x, options);
    if flag <= 0, error('nlvib_path: %s did not converge at %g', name, omega(i)); end
    amplitude(i) = hypot(x(n + place), x(2 * n + place));
  end
  printf('%s %.6g', name, 1e3 * (cputime() - begun) / points);
  printf(' %.9g', amplitude); printf('\n');
end

addpath(fullfile(getenv('NLVIB'), 'SRC'));
sweep('sdof', 1, 0.02, 1, 1, 1, 1, 1, 7, 256, 1.1, 1.6, 51);
for elements = [5, 10, 20]
  [M, K] = cantilever(elements);
  sweep(sprintf('cantilever%d', 2 * elements), M, 0.02 * M + 0.0005 * K, K, 2 * elements - 1, 5, 0.5, 0.3, 5, 128, 3.4, 5, 21);
end
