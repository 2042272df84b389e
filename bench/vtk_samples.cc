#include <vtkImageData.h>
#include <vtkImageInterpolator.h>
#include <vtkImplicitVolume.h>
#include <vtkSmartPointer.h>

#include <algorithm>

#include "entrant.h"

namespace palpate::bench {

std::vector<Entrant> vtk_entrants(const std::shared_ptr<const SampledWork>& work) {
  const GridGeometry& grid = work->bytes.geometry();
  const auto image = vtkSmartPointer<vtkImageData>::New();
  image->SetDimensions(grid.dims.data());
  image->SetSpacing(grid.spacing_mm.data());
  image->AllocateScalars(VTK_UNSIGNED_CHAR, 1);
  std::copy(work->bytes.voxels().begin(), work->bytes.voxels().end(),
            static_cast<std::uint8_t*>(image->GetScalarPointer()));

  const auto interpolator = vtkSmartPointer<vtkImageInterpolator>::New();
  interpolator->SetInterpolationModeToLinear();
  interpolator->Initialize(image);
  interpolator->Update();
  const auto implicit = vtkSmartPointer<vtkImplicitVolume>::New();
  implicit->SetVolume(image);

  return {entrant("VTK interpolator, seven samples",
                  [=, spacing_mm = grid.spacing_mm](const Point<Patient>& p) {
                    const auto value = [&](double x, double y, double z) {
                      return interpolator->Interpolate(x, y, z, 0) / 255;
                    };
                    const double x = p.x(), y = p.y(), z = p.z();
                    const double hx = spacing_mm[0], hy = spacing_mm[1], hz = spacing_mm[2];
                    return FieldSample{
                        value(x, y, z),
                        Vector<Patient>((value(x + hx, y, z) - value(x - hx, y, z)) / (2 * hx),
                                        (value(x, y + hy, z) - value(x, y - hy, z)) / (2 * hy),
                                        (value(x, y, z + hz) - value(x, y, z - hz)) / (2 * hz))};
                  }),
          entrant("VTK implicit volume", [=](const Point<Patient>& p) {
            double x[3] = {p.x(), p.y(), p.z()}, gradient[3];
            const double value = implicit->EvaluateFunction(x);
            implicit->EvaluateGradient(x, gradient);
            // VTK's gradient points down the slope
            return FieldSample{value / 255,
                               Vector<Patient>(-gradient[0] / 255, -gradient[1] / 255, -gradient[2] / 255)};
          })};
}

}  // namespace palpate::bench
