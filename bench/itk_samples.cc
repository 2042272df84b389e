#include <itkBSplineInterpolateImageFunction.h>
#include <itkCentralDifferenceImageFunction.h>
#include <itkImage.h>
#include <itkLinearInterpolateImageFunction.h>

#include <algorithm>

#include "entrant.h"

namespace palpate::bench {

namespace {

using Image = itk::Image<std::uint8_t, 3>;
using Linear = itk::LinearInterpolateImageFunction<Image, double>;
using Differences = itk::CentralDifferenceImageFunction<Image, double>;
using Spline = itk::BSplineInterpolateImageFunction<Image, double, double>;

Image::Pointer to_image(const Volume<std::uint8_t>& volume) {
  const GridGeometry& grid = volume.geometry();
  Image::SizeType size;
  Image::SpacingType spacing;
  for (int axis = 0; axis < 3; ++axis) {
    size[axis] = static_cast<itk::SizeValueType>(grid.dims[axis]);
    spacing[axis] = grid.spacing_mm[axis];
  }
  auto image = Image::New();
  image->SetRegions(size);
  image->SetSpacing(spacing);
  image->Allocate();
  std::copy(volume.voxels().begin(), volume.voxels().end(), image->GetBufferPointer());
  return image;
}

template <class Gradient>
FieldSample to_sample(double value, const Gradient& gradient) {
  return {value / 255, Vector<Patient>(gradient[0] / 255, gradient[1] / 255, gradient[2] / 255)};
}

Image::PointType to_itk(const Point<Patient>& p) {
  Image::PointType point;
  for (int axis = 0; axis < 3; ++axis) point[axis] = p[axis];
  return point;
}

}  // namespace

std::vector<Entrant> itk_entrants(const std::shared_ptr<const SampledWork>& work) {
  const Image::Pointer image = to_image(work->bytes);
  const auto linear = Linear::New();
  linear->SetInputImage(image);
  const auto differences = Differences::New();
  differences->SetInputImage(image);
  differences->SetInterpolator(linear);
  return {entrant(
              "ITK linear + difference, by point",
              [=](const Point<Patient>& p) {
                const auto point = to_itk(p);
                return to_sample(linear->Evaluate(point), differences->Evaluate(point));
              },
              // evaluated by point, the differences are taken at half a voxel to either side
              Compared::kValue),
          entrant("ITK linear + difference, by index", [=](const Point<Patient>& p) {
            const Point<Voxel> x = work->X_VoxelPatient * p;
            Linear::ContinuousIndexType index;
            for (unsigned axis = 0; axis < 3; ++axis) index[axis] = x[static_cast<int>(axis)];
            return to_sample(linear->EvaluateAtContinuousIndex(index),
                             differences->EvaluateAtContinuousIndex(index));
          })};
}

Entrant itk_spline(const std::shared_ptr<const SampledWork>& work) {
  const auto spline = Spline::New();
  spline->SetSplineOrder(3);
  spline->SetInputImage(to_image(work->bytes));
  return entrant("ITK cubic B-spline", [=](const Point<Patient>& p) {
    double value = 0;
    Spline::CovariantVectorType gradient;
    spline->EvaluateValueAndDerivative(to_itk(p), value, gradient);
    return to_sample(value, gradient);
  });
}

}  // namespace palpate::bench
