#include "itk_gaussian.h"

#include <itkDiscreteGaussianImageFilter.h>
#include <itkImage.h>
#include <itkMultiThreaderBase.h>
#include <itkSmoothingRecursiveGaussianImageFilter.h>

#include <algorithm>

namespace palpate::bench {

namespace {

using Bytes = itk::Image<std::uint8_t, 3>;
using Floats = itk::Image<float, 3>;

template <class Filter>
Floats::Pointer run(Filter& filter, const Bytes* bytes, int threads) {
  itk::MultiThreaderBase::SetGlobalMaximumNumberOfThreads(threads);
  itk::MultiThreaderBase::SetGlobalDefaultNumberOfThreads(threads);
  filter.SetInput(bytes);
  filter.SetNumberOfWorkUnits(threads);
  filter.Update();
  return filter.GetOutput();
}

}  // namespace

struct ItkGaussian::Images {
  Bytes::Pointer bytes = Bytes::New();
  Floats::Pointer smooth;
};

ItkGaussian::ItkGaussian(const Volume<std::uint8_t>& volume) : images_(std::make_unique<Images>()) {
  const GridGeometry& grid = volume.geometry();
  Bytes::SizeType size;
  Bytes::SpacingType spacing;
  for (int axis = 0; axis < 3; ++axis) {
    size[axis] = grid.dims[axis];
    spacing[axis] = grid.spacing_mm[axis];
  }
  images_->bytes->SetRegions(size);
  images_->bytes->SetSpacing(spacing);
  images_->bytes->Allocate();
  std::copy(volume.voxels().begin(), volume.voxels().end(), images_->bytes->GetBufferPointer());
}

ItkGaussian::~ItkGaussian() = default;

void ItkGaussian::smooth_recursive(double sigma_mm, int threads) {
  const auto filter = itk::SmoothingRecursiveGaussianImageFilter<Bytes, Floats>::New();
  filter->SetSigma(sigma_mm);
  images_->smooth = run(*filter, images_->bytes, threads);
}

void ItkGaussian::smooth_discrete(double sigma_mm, int threads) {
  const auto filter = itk::DiscreteGaussianImageFilter<Bytes, Floats>::New();
  filter->SetVariance(sigma_mm * sigma_mm);
  filter->SetMaximumKernelWidth(100);
  filter->SetUseImageSpacing(true);
  images_->smooth = run(*filter, images_->bytes, threads);
}

const float* ItkGaussian::result() const {
  return images_->smooth->GetBufferPointer();
}

}  // namespace palpate::bench
