#pragma once

/// Exact Gaussian smoothing of the indicator function (1 inside, 0 outside) of solids, in closed form or by
/// quadrature to 1e-7. Lengths in mm; sigma > 0.
namespace palpate {

/// Half-space: normal distribution function of -distance / sigma.
double smoothed_half_space(double distance, double sigma);

/// Ball of `radius` at `r` from its centre, in closed form.
double smoothed_ball(double r, double radius, double sigma);

/// Disc of `radius` in the plane, or infinite cylinder in space, at `rho` from its axis.
double smoothed_disc(double rho, double radius, double sigma);

/// Solid torus, at `rho` from its axis and `z` above its plane.
double smoothed_torus(double rho, double z, double major_radius, double minor_radius, double sigma);

}  // namespace palpate
