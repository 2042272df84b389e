#include "volume_io/itk_oracle.h"

#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

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

}  // namespace

std::optional<std::vector<double>> itk_voxels(volume_io::ItkFormat format,
                                              const std::filesystem::path& file) {
  itk::ImageIOBase::Pointer io;
  if (format == volume_io::ItkFormat::kNrrd) io = itk::NrrdImageIO::New().GetPointer();
  if (format == volume_io::ItkFormat::kNifti) io = itk::NiftiImageIO::New().GetPointer();
  if (format == volume_io::ItkFormat::kMetaImage) io = itk::MetaImageIO::New().GetPointer();
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
