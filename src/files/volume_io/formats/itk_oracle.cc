#include "volume_io/formats/itk_oracle.h"

#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include <algorithm>
#include <cstring>

namespace palpate::testing {
namespace {

using Itk = itk::CommonEnums::IOComponent;

template <class T>
std::vector<double> values(const std::vector<char>& bytes) {
  std::vector<double> result(bytes.size() / sizeof(T));
  for (std::size_t n = 0; n < result.size(); ++n) {
    T value;
    std::memcpy(&value, bytes.data() + n * sizeof(T), sizeof(T));
    result[n] = static_cast<double>(value);
  }
  return result;
}

itk::ImageIOBase::Pointer create(volume_io::ItkFormat format) {
  // ITK would print warnings to stderr
  itk::Object::SetGlobalWarningDisplay(false);
  if (format == volume_io::ItkFormat::kNrrd) return itk::NrrdImageIO::New().GetPointer();
  if (format == volume_io::ItkFormat::kNifti) return itk::NiftiImageIO::New().GetPointer();
  return itk::MetaImageIO::New().GetPointer();
}

}  // namespace

std::optional<volume_io::ItkGrid> itk_grid_of(volume_io::ItkFormat format,
                                              const std::filesystem::path& file) {
  const auto io = create(format);
  try {
    io->SetFileName(file.string());
    io->ReadImageInformation();
  } catch (const std::exception&) {
    return std::nullopt;
  }
  volume_io::ItkGrid grid;
  const unsigned axes = std::min(io->GetNumberOfDimensions(), 3u);
  for (unsigned a = 0; a < axes; ++a) {
    grid.dims[a] = static_cast<int>(io->GetDimensions(a));
    grid.spacing_mm[a] = io->GetSpacing(a);
    grid.origin_mm[a] = io->GetOrigin(a);
    const std::vector<double> column = io->GetDirection(a);
    for (unsigned r = 0; r < axes; ++r) grid.columns[a][r] = column[r];
  }
  return grid;
}

std::optional<std::vector<double>> itk_voxels(volume_io::ItkFormat format,
                                              const std::filesystem::path& file) {
  const auto io = create(format);
  std::vector<char> bytes;
  try {
    io->SetFileName(file.string());
    io->ReadImageInformation();
    itk::ImageIORegion region(io->GetNumberOfDimensions());
    for (unsigned a = 0; a < io->GetNumberOfDimensions(); ++a) region.SetSize(a, io->GetDimensions(a));
    io->SetIORegion(region);
    bytes.resize(io->GetImageSizeInBytes());
    io->Read(bytes.data());
  } catch (const std::exception&) {
    return std::nullopt;
  }
  switch (io->GetComponentType()) {
    case Itk::CHAR:
      return values<signed char>(bytes);
    case Itk::UCHAR:
      return values<unsigned char>(bytes);
    case Itk::SHORT:
      return values<short>(bytes);
    case Itk::USHORT:
      return values<unsigned short>(bytes);
    case Itk::INT:
      return values<int>(bytes);
    case Itk::UINT:
      return values<unsigned>(bytes);
    case Itk::LONG:
      return values<long>(bytes);
    case Itk::ULONG:
      return values<unsigned long>(bytes);
    case Itk::LONGLONG:
      return values<long long>(bytes);
    case Itk::ULONGLONG:
      return values<unsigned long long>(bytes);
    case Itk::FLOAT:
      return values<float>(bytes);
    case Itk::DOUBLE:
      return values<double>(bytes);
    default:
      return std::nullopt;
  }
}

}  // namespace palpate::testing
