// Compliance of soft tissue in the five cases for which calculix.py runs CalculiX. See README.md.

#include <cmath>
#include <cstdio>
#include <functional>
#include <nlohmann/json.hpp>
#include <numbers>
#include <string>
#include <vector>

#include "palpate/tissue/elastic_contact.h"
#include "palpate/tissue/elastic_solver.h"

namespace palpate::bench {
namespace {

// a body on a plate with surface z = 0, under a pressure patch at its centre
struct PressedBody {
  std::string name;
  std::function<ElasticMaterial(const Point<Patient>&)> material;
  double rho_mm = 3;
  int thick_mm = 24;
};

constexpr int kAcross_mm = 48;

ElasticMaterial soft(double kPa, double nu = 0.45) {
  return {Matter::kSoft, kPa, nu};
}

std::vector<PressedBody> pressed_bodies() {
  return {
      {"layer", [](const Point<Patient>&) { return soft(10); }},
      {"nodule",
       [](const Point<Patient>& p) {
         const bool is_inside = std::abs(p.x()) < 4 && std::abs(p.y()) < 4 && p.z() < -5 && p.z() > -13;
         return soft(is_inside ? 100 : 10);
       }},
      {"skin", [](const Point<Patient>& p) { return soft(p.z() > -2 ? 100 : 10); }},
      {"hard-edge",
       [](const Point<Patient>& p) {
         return p.x() > 1 && p.z() < -5 ? ElasticMaterial{Matter::kRigid, 0, 0} : soft(10);
       }},
      {"thin-layer", [](const Point<Patient>&) { return soft(10, 0.49); }, 4, 8},
  };
}

// points of equal force under the patch's pressure, many more than in the tick's patch, because a fine grid
// resolves them
std::vector<Point<Patient>> pressed_points(double rho_mm) {
  constexpr int kPoints = 4096;
  const double golden_angle = std::numbers::pi * (3 - std::sqrt(5.0));
  std::vector<Point<Patient>> positions;
  for (int n = 0; n < kPoints; ++n) {
    // the force within r is a fraction 1 - (1 - r2 / rho2)^(3/2)
    const double beyond = std::cbrt(1 - (n + 0.5) / kPoints), r_mm = rho_mm * std::sqrt(1 - beyond * beyond);
    positions.emplace_back(r_mm * std::cos(n * golden_angle), r_mm * std::sin(n * golden_angle), 0);
  }
  return positions;
}

// compliance W, mm/N
double compliance(const PressedBody& body, double cell_mm) {
  const int across = static_cast<int>(std::lround(kAcross_mm / cell_mm));
  const int deep = static_cast<int>(std::lround(body.thick_mm / cell_mm));
  ElasticBox box;
  box.cell_mm = cell_mm;
  // the lowest layer is the plate
  box.cells = {across, across, deep + 1};
  box.corner = Point<Patient>(-0.5 * kAcross_mm, -0.5 * kAcross_mm, -(deep + 1) * cell_mm);
  const ElasticGrid grid(
      box,
      [&](const Point<Patient>& p) {
        return p.z() < -body.thick_mm ? ElasticMaterial{Matter::kRigid, 0, 0} : body.material(p);
      },
      8);
  const PressurePatch patch(grid, pressed_points(body.rho_mm), Vector<Patient>(0, 0, 1));
  ElasticField unit_mm(grid.layout()), load_N(grid.layout());
  patch.add(1, load_N);
  ElasticSolver(grid).solve(load_N, unit_mm, 300, 1e-6);
  return patch.displacement_mm(unit_mm);
}

int run() {
  nlohmann::ordered_json reported;
  for (const char* cell_mm : {"1", "0.5"})
    for (const PressedBody& body : pressed_bodies())
      reported[cell_mm][body.name] = compliance(body, std::stod(cell_mm));
  std::printf("%s\n", reported.dump(2).c_str());
  return 0;
}

}  // namespace
}  // namespace palpate::bench

int main() {
  return palpate::bench::run();
}
