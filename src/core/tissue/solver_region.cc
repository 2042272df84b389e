#include "tissue/solver_region.h"

#include <algorithm>
#include <cmath>

#include "tissue/elastic_multigrid.h"

namespace palpate {

void SoftTissueSolver::Region::solve_neo_hookean(const PressurePatch& patch, double depth_mm,
                                                 bool is_first_solve, LocalCompliance& local) {
  constexpr double kReductionAfterFailure = 0.7;  // factor of the attempted indentation ratio
  constexpr double kGrowthAfterSuccess = 1.1;     // factor of max_indentation_ratio
  constexpr double kMaxExtrapolation = 2;         // maximum ratio of the displacements of consecutive frames
  constexpr double kAtRestTolerance = 0.05;       // relative change of depth below which the tool is at rest
  NeoHookeanBody& body = *neo_hookean;
  const auto is_as_deep = [&](double mm) { return std::abs(depth_mm - mm) <= kAtRestTolerance * mm; };
  const bool at_rest = body.depth_mm > 0 && is_as_deep(body.depth_mm);
  body.depth_mm = std::max(depth_mm, 0.0);
  if (body.failed_depth_mm > 0 && !is_as_deep(body.failed_depth_mm)) body.failed_depth_mm = 0;
  const ConstrainedMeans surface = patch.columns(kSolverSettings.min_load_fraction);

  // displacement of the patch at the predicted depth, by the last published contact law
  const double w = local.compliance_mm_per_N, rho_mm = local.patch_radius_mm;
  ContactLaw tissue;
  tissue.surroundings_mm_per_N = local.surroundings_mm_per_N;
  tissue.poissons_ratio = local.poissons_ratio;
  tissue.modulus_N_per_mm2 = local.modulus_N_per_mm2;
  tissue.stiffening_mm_per_N2 = body.stiffening_mm_per_N2;
  tissue.reference_force_N = body.reference_force_N;
  const double expected_N = soft_contact_force(tissue, depth_mm, radius_mm).force_N;
  const double expected_mm =
      w * expected_N - stiffening_depth_mm(body.stiffening_mm_per_N2, body.reference_force_N, expected_N);
  const double indentation_mm =
      std::clamp(expected_mm, kSolverSettings.min_indentation * rho_mm, body.max_indentation_ratio * rho_mm);
  const double s = indentation_mm / w;

  // initial guess: the previous correction, which grows with the square of the displacement
  const double growth =
      body.indentation_mm > 0 ? std::min(indentation_mm / body.indentation_mm, kMaxExtrapolation) : 0;
  const auto correction_scale = static_cast<float>(growth * growth), load_scale = static_cast<float>(s);
  for (float& value : body.excess_response_mm.values) value *= correction_scale;
  for (float& value : body.correction_mm.values) value *= correction_scale;
  surface.project_out(body.correction_mm.values);
  for (std::size_t n = 0; n < body.u_mm.values.size(); ++n)
    body.u_mm.values[n] = load_scale * unit_mm.values[n] + body.correction_mm.values[n];

  // load_N is the patch's load of 1 N, here scaled to s. Columns that bear less than min_load_fraction are
  // not constrained; the load acts at their nodes alone.
  for (float& value : load_N.values) value *= load_scale;
  NeoHookeanSettings settings;
  settings.max_steps = kSolverSettings.finite_steps;
  settings.max_iterations =
      is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.finite_iterations;
  settings.min_volume = kSolverSettings.min_volume;
  const NeoHookeanSolution solution = solver.solve_neo_hookean(load_N, body.u_mm, settings, surface);
  solver.neo_hookean_forces(body.u_mm, body.force_N);
  const double force_N = internal::elastic::dot(unit_mm.values, body.force_N.values) / w;
  const double relative_stiffening = (force_N - s) / force_N;
  if (!(solution.min_volume >= kSolverSettings.min_volume) || solution.line_search_failed ||
      !(std::abs(relative_stiffening) <= kSoftTissueSettings.max_stiffening) || !(force_N > 0)) {
    const double reduced_ratio =
        std::max(kReductionAfterFailure * indentation_mm / rho_mm, kSolverSettings.min_indentation);
    if (at_rest && body.reference_force_N > 0) {
      // The previous result stays in effect, and no greater displacement is attempted until the tool moves:
      // otherwise the force on a resting tool would oscillate with every attempt.
      local.reference_force_N = body.reference_force_N;
      local.stiffening_mm_per_N2 = body.stiffening_mm_per_N2;
      body.indentation_mm = indentation_mm;
      body.failed_depth_mm = depth_mm;
    } else {
      // falls back to the linear law; the next attempt is shallower and starts from the linear solution
      body.reset();
    }
    body.max_indentation_ratio = reduced_ratio;
    return;
  }
  for (std::size_t n = 0; n < body.u_mm.values.size(); ++n)
    body.correction_mm.values[n] = body.u_mm.values[n] - load_scale * unit_mm.values[n];
  body.indentation_mm = indentation_mm;
  if (body.failed_depth_mm == 0)
    body.max_indentation_ratio =
        std::min(kGrowthAfterSuccess * body.max_indentation_ratio, kSolverSettings.max_indentation);

  // K (y - F u1) = f(u) - F J^T: the response to the forces that exceed those of the linear body under F
  patch.add(-force_N, body.force_N);
  solver.solve(body.force_N, body.excess_response_mm,
               is_first_solve ? kSolverSettings.first_iterations : kSolverSettings.tangential_iterations,
               kLinearTolerance);
  local.reference_force_N = body.reference_force_N = force_N;
  local.stiffening_mm_per_N2 = body.stiffening_mm_per_N2 = w * relative_stiffening / force_N;
  local.stiffening_gradient = (local.gradient_per_N * (0.5 * force_N * (force_N - s)) +
                               patch.gradient_along_surface(body.excess_response_mm) * s) *
                              (3 / (force_N * force_N * force_N));
  if (!local.stiffening_gradient.all_finite()) local.stiffening_gradient = {};
}

}  // namespace palpate
