#include "volume_io/formats/itk_io.h"

#include <itkMetaDataObject.h>
#include <itkMetaImageIO.h>
#include <itkNiftiImageIO.h>
#include <itkNrrdImageIO.h>

#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

itk::ImageIOBase::Pointer create(ItkFormat format) {
  // ITK would print warnings to stderr
  itk::Object::SetGlobalWarningDisplay(false);
  switch (format) {
    case ItkFormat::kNrrd:
      return itk::NrrdImageIO::New().GetPointer();
    case ItkFormat::kNifti:
      return itk::NiftiImageIO::New().GetPointer();
    case ItkFormat::kMetaImage:
      break;
  }
  return itk::MetaImageIO::New().GetPointer();
}

// last line of an exception's text, which gives the actual reason
std::string reason(const std::exception& exception) {
  std::string_view text = exception.what();
  std::string last;
  while (!text.empty()) {
    const std::string_view line = trimmed(read_line(text));
    if (!line.empty()) last = std::string(line);
  }
  return last.substr(0, 200);
}

itk::CommonEnums::IOComponent itk_component(Component component) {
  using Itk = itk::CommonEnums::IOComponent;
  switch (component) {
    case Component::kInt8:
      return Itk::CHAR;
    case Component::kUint8:
      return Itk::UCHAR;
    case Component::kInt16:
      return Itk::SHORT;
    case Component::kUint16:
      return Itk::USHORT;
    case Component::kInt32:
      return Itk::INT;
    case Component::kUint32:
      return Itk::UINT;
    case Component::kInt64:
      return Itk::LONGLONG;
    case Component::kUint64:
      return Itk::ULONGLONG;
    case Component::kFloat32:
      return Itk::FLOAT;
    case Component::kFloat64:
      break;
  }
  return Itk::DOUBLE;
}

itk::ImageIORegion whole(const itk::ImageIOBase& io) {
  itk::ImageIORegion region(io.GetNumberOfDimensions());
  for (unsigned a = 0; a < io.GetNumberOfDimensions(); ++a) region.SetSize(a, io.GetDimensions(a));
  return region;
}

}  // namespace

Result<void> itk_write(ItkFormat format, const std::filesystem::path& file, const ItkImage& image) {
  const ItkSection section;
  try {
    const auto io = create(format);
    io->SetFileName(file.string());
    io->SetNumberOfDimensions(3);
    for (unsigned a = 0; a < 3; ++a) {
      io->SetDimensions(a, static_cast<unsigned>(image.grid.dims[a]));
      io->SetSpacing(a, image.grid.spacing_mm[a]);
      io->SetOrigin(a, image.grid.origin_mm[a]);
      const auto& column = image.grid.columns[a];
      io->SetDirection(a, std::vector<double>(column.begin(), column.end()));
    }
    io->SetComponentType(itk_component(image.component));
    io->SetNumberOfComponents(static_cast<unsigned>(image.components));
    io->SetPixelType(image.components == 1 ? itk::CommonEnums::IOPixel::SCALAR
                                           : itk::CommonEnums::IOPixel::VECTOR);
    for (const auto& [key, text] : image.text_fields)
      itk::EncapsulateMetaData<std::string>(io->GetMetaDataDictionary(), key, text);
    io->SetIORegion(whole(*io));
    io->SetUseCompression(true);
    io->Write(image.voxels);
    return {};
  } catch (const std::exception& exception) {
    return Error{ErrorKind::kOutput, "cannot be written: " + reason(exception), file.string(), ""};
  }
}

}  // namespace palpate::volume_io

#ifdef __SANITIZE_ADDRESS__
// the libraries below ITK's image IO leak their state when they fail, for example on a full disk
extern "C" const char* __lsan_default_suppressions();
extern "C" const char* __lsan_default_suppressions() {
  return "leak:libITK\n";
}
#endif
