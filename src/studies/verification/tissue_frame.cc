#include "verification/tissue_frame.h"

#include <time.h>

#include <algorithm>
#include <cmath>

#include "palpate/tissue/elastic_contact.h"

namespace palpate {
namespace {

// the same memory traffic as K u: reads displacements and moduli, writes forces
void stream(const ElasticField& u, const ElasticValues& mu, const ElasticValues& lambda,
            ElasticField& force) {
  const std::size_t cells = mu.size() - ElasticLayout::kSpare;
  const float* const in = u.values.data();
  float* const out = force.values.data();
  for (std::size_t n = 0; n < cells; ++n) {
    const float by = mu[n] + lambda[n];
    out[3 * n] = by * in[3 * n];
    out[3 * n + 1] = by * in[3 * n + 1];
    out[3 * n + 2] = by * in[3 * n + 2];
  }
}

template <class Work>
double fastest_s(int times, const Work& work) {
  double best = 1e9;
  for (int n = 0; n < times; ++n) {
    const double begin = tissue_thread_seconds();
    work();
    best = std::min(best, tissue_thread_seconds() - begin);
  }
  return best;
}

}  // namespace

double tissue_thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

TissueFrame measure_tissue_frame(int frames) {
  constexpr int kTimes = 20, kIterations = 2;
  constexpr double kStep_mm = 20.0 / 60;
  ElasticBox box;
  box.cells = {79, 45, 12};
  ElasticGrid grid(
      box,
      [](const Point<Patient>& p) {
        if (p.z() < 1) return ElasticMaterial{Matter::kRigid, 0, 0};
        return ElasticMaterial{Matter::kSoft, p.z() < 6 ? 30.0 : 10.0, 0.45};
      },
      1);
  const Vector<Patient> up(0, 0, 1);
  const auto displaced_point = [&](int frame) { return Point<Patient>(32 + kStep_mm * frame, 22.3, 12); };
  grid.set_boundary_springs({true, true, true, true, false, false}, displaced_point(0));
  ElasticSolver solver(grid);
  ElasticField unit(solver.layout()), load(solver.layout()), converged(solver.layout()),
      force(solver.layout());

  TissueFrame result;
  result.cells = grid.soft_cells();
  std::vector<double> seconds;
  for (int frame = 0; frame < frames; ++frame) {
    const PressurePatch patch(grid, displaced_point(frame), up, 2);
    std::fill(load.values.begin(), load.values.end(), 0.0f);
    patch.add(1, load);
    if (frame == 0) solver.solve(load, unit, 100, 1e-4);
    const double begin = tissue_thread_seconds();
    solver.solve(load, unit, kIterations, 0);
    seconds.push_back(tissue_thread_seconds() - begin);
    solver.solve(load, converged, 100, 1e-5);
    result.error_percent =
        std::max(result.error_percent,
                 100 * std::abs(patch.displacement_mm(unit) / patch.displacement_mm(converged) - 1));
  }
  std::nth_element(seconds.begin(), seconds.begin() + frames / 2, seconds.end());
  result.frame_ms = 1e3 * seconds[static_cast<std::size_t>(frames / 2)];
  const double per_cell = 1e9 / static_cast<double>(result.cells);
  result.kernel_ns = per_cell * fastest_s(kTimes, [&] { solver.forces(unit, force); });
  result.floor_ns = per_cell * fastest_s(kTimes, [&] { stream(unit, grid.mu(), grid.lambda(), force); });
  return result;
}

}  // namespace palpate
