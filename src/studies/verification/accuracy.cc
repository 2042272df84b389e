#include "verification/accuracy.h"

#include <algorithm>
#include <new>

#include "verification/accuracy_bench.h"

// Every shape is voxelised on every grid, prepared as a scene would be and sampled by every method; it is
// then also sampled exactly, which isolates storage and interpolation. Quantities:
//   direction    angle between -gradient / |gradient| and the exact surface normal at that point, degrees
//   magnitude    value minus that of the method's own filter applied to the exact solid, percent of full
//                force; for a signed distance the error of the distance, micrometres
//   choppiness   change of the force over 0.01 mm along paths at constant depth, percent of full force
namespace palpate {
namespace {

// groups the figures by method
void sort_by_method(std::vector<Figure>& figures) {
  std::stable_sort(figures.begin(), figures.end(), [](const Figure& a, const Figure& b) {
    return a.name.substr(0, a.name.find('/')) < b.name.substr(0, b.name.find('/'));
  });
}

}  // namespace

Result<std::vector<Figure>> run_accuracy(const Progress& progress) try {
  constexpr int kPoints = 4000;
  std::vector<Figure> figures;
  const std::vector<AccuracyCase> cases = accuracy_cases(kPoints);
  const double steps = static_cast<double>(cases.size() * accuracy_spacings().size());
  double done = 0;
  for (const AccuracyCase& shape : cases) {
    progress.report("accuracy", done / steps);
    if (progress.stopped()) return Progress::interrupted();
    const ShapeTruth truth(shape);
    for (const AccuracySpacing& spacing : accuracy_spacings()) {
      progress.report("accuracy", done / steps);
      const auto more = measure_on_grid(truth, shape.name + "/" + spacing.name, spacing.mm, progress);
      if (!more) return more.error();
      figures.insert(figures.end(), more->begin(), more->end());
      ++done;
    }
  }
  progress.report("accuracy", 1);
  sort_by_method(figures);
  return figures;
} catch (const std::bad_alloc&) {
  return Error{ErrorKind::kBadInput, "not enough memory for the accuracy suite", "", "it needs about 350 MB"};
}

}  // namespace palpate
