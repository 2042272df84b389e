#pragma once

/// What a perfect Gaussian filter makes of a solid that is 1 inside and 0 outside, in closed form or by
/// quadrature to better than 1e-7. All lengths mm; sigma > 0.
namespace palpate {

/// Half-space: the normal distribution function of -distance / sigma.
double smoothed_half_space(double distance, double sigma);

/// Ball of `radius` at `r` from its centre, in closed form.
double smoothed_ball(double r, double radius, double sigma);

/// Disc of `radius` in the plane, or endless cylinder in space, at `rho` from its axis.
double smoothed_disc(double rho, double radius, double sigma);

/// Solid torus, at `rho` from its axis and `z` above its plane.
double smoothed_torus(double rho, double z, double major_radius, double minor_radius, double sigma);

}  // namespace palpate
