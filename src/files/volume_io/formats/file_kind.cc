#include "volume_io/formats/file_kind.h"

#include <algorithm>
#include <array>

#include "volume_io/labels/label_text.h"

namespace palpate::volume_io {
namespace {

using namespace std::string_view_literals;

constexpr const char* kWithScan =
    "its contours have no voxels of their own: give it after the scan that they were drawn on, as in palpate "
    "scene new "
    "STUDY STRUCTURES";
constexpr const char* kConvertSurface =
    "forces are computed from voxels: load it in 3D Slicer as a segmentation, with the scan as its reference "
    "geometry, and save that as .seg.nrrd";
constexpr const char* kConvertVolume = "load it in 3D Slicer and save it as NRRD";
constexpr const char* kPicture =
    "a picture has no depth: give the volume that it was made from, as NRRD, NIfTI or MetaImage";
constexpr const char* kUnpack = "unpack it, and give the volume that is in it";

bool ends_with(const std::string& name, std::string_view ending) {
  return name.size() > ending.size() && std::string_view(name).ends_with(ending);
}

std::uint32_t little_at(std::string_view bytes, std::size_t at, std::size_t count) {
  std::uint32_t value = 0;
  for (std::size_t n = count; n-- > 0;) value = value << 8 | static_cast<unsigned char>(bytes[at + n]);
  return value;
}

// ---- DICOM --------------------------------------------------------------------------------------

// value of a UI element of a DICOM data set in little endian, with explicit or implicit type
std::string_view dicom_text(std::string_view bytes, std::string_view tag) {
  for (auto at = bytes.find(tag); at != std::string_view::npos; at = bytes.find(tag, at + 1)) {
    if (at + 8 > bytes.size()) return {};
    const bool typed = bytes.substr(at + 4, 2) == "UI";
    const std::size_t length = typed ? little_at(bytes, at + 6, 2) : little_at(bytes, at + 4, 4);
    constexpr std::size_t kMaxUid = 64;
    if (length <= kMaxUid && at + 8 + length <= bytes.size())
      return bytes.substr(at + 8, length);  // padded to an even length with 0
  }
  return {};
}

bool is_dicom(std::string_view front) {
  if (front.size() > 132 && front.substr(128, 4) == "DICM") return true;
  // without the preamble a data set begins with an element of group 8, with explicit or implicit type
  if (front.size() < 16 || front.substr(0, 2) != "\x08\0"sv || front[3] != 0) return false;
  if ("\0\5\x08\x12\x16\x18"sv.find(front[2]) == std::string_view::npos) return false;
  const bool typed =
      std::all_of(front.begin() + 4, front.begin() + 6, [](char c) { return c >= 'A' && c <= 'Z'; });
  return typed || little_at(front, 4, 4) <= 64;
}

FileKind dicom_kind(std::string_view front) {
  // SOP class of the object: from the meta header, otherwise from the data set
  std::string_view uid = dicom_text(front, "\x02\0\x02\0"sv);
  if (uid.empty()) uid = dicom_text(front, "\x08\0\x16\0"sv);
  uid = uid.substr(0, uid.find('\0'));
  constexpr std::string_view kStorage = "1.2.840.10008.5.1.4.1.1.";
  if (uid == "1.2.840.10008.1.3.10") {
    FileKind directory{"a DICOMDIR, the list of contents of a DICOM disc", "give it as the scan", "DICOM"};
    directory.dicom_directory = true;
    return directory;
  }
  if (uid.starts_with(kStorage)) {
    const std::string_view kind = uid.substr(kStorage.size());
    if (kind == "66.4" || kind == "66.7")
      return {
          "a DICOM segmentation (SEG)", "give it as the labels, under any name", "DICOM", false, true, true};
    if (kind == "66.5") return {"a DICOM surface segmentation", kConvertSurface, {}};
    if (kind == "481.3") {
      FileKind structures{"a DICOM structure set (RTSTRUCT)", kWithScan, {}};
      structures.dicom_structures = true;
      return structures;
    }
    if (kind == "481.2") return {"a DICOM dose (RTDOSE)", "give the scan that it was planned on", {}};
    if (kind.starts_with("88.")) return {"a DICOM report (SR)", "give the scan that it is about", {}};
  }
  return {"a DICOM file", "give it a name that ends in .dcm, or name its folder", "DICOM", true};
}

// ---- surfaces -----------------------------------------------------------------------------------

std::optional<FileKind> surface_kind(std::string_view front, const std::string& name, std::uint64_t size) {
  const auto surface = [](const char* format) {
    return FileKind{std::string("a surface (") + format + "), not voxels", kConvertSurface, {}};
  };
  const auto mesh = [](const char* format, MeshFormat kind) {
    FileKind read{std::string("a surface (") + format + ")", "give it as the labels, under any name",
                  "surface"};
    read.mesh = kind;
    return read;
  };
  constexpr std::size_t kStlHeader = 84, kStlTriangle = 50;
  if (front.size() >= kStlHeader &&
      size == kStlHeader + kStlTriangle * std::uint64_t{little_at(front, 80, 4)})
    return mesh("STL", MeshFormat::kStl);
  if (front.starts_with("solid") &&
      (front.find("facet") != std::string_view::npos || ends_with(name, ".stl")))
    return mesh("STL", MeshFormat::kStl);
  if (front.starts_with("ply\n") || front.starts_with("ply\r")) return mesh("PLY", MeshFormat::kPly);
  if (front.starts_with("OFF\n") || front.starts_with("OFF\r")) return surface("OFF");
  if (front.starts_with("glTF")) return surface("glTF");
  if (front.starts_with("\xFF\xFF\xFE"sv)) return surface("FreeSurfer");
  if (ends_with(name, ".obj") && (front.starts_with("v ") || front.find("\nv ") != std::string_view::npos))
    return mesh("OBJ", MeshFormat::kObj);
  if (ends_with(name, ".stl")) return mesh("STL", MeshFormat::kStl);

  // VTK's own formats store surfaces and images
  const bool legacy = front.starts_with("# vtk DataFile"),
             xml = front.find("<VTKFile") != std::string_view::npos;
  if (legacy || xml) {
    for (const auto image : {"STRUCTURED_POINTS", "RECTILINEAR_GRID", "\"ImageData\""})
      if (front.find(image) != std::string_view::npos)
        return FileKind{"an image in VTK's own format", kConvertVolume, {}};
    if (legacy && front.find("POLYDATA") != std::string_view::npos)
      return mesh("VTK polydata", MeshFormat::kVtkLegacy);
    if (xml && front.find("\"PolyData\"") != std::string_view::npos)
      return mesh("VTK polydata", MeshFormat::kVtkXml);
    return surface("VTK");
  }
  return std::nullopt;
}

// ---- by first bytes ------------------------------------------------------------------------------

struct Magic {
  std::string_view bytes;
  std::size_t at;
  const char* what;
  const char* remedy;
};

constexpr const char* kStack =
    "give the folder with all slices of its volume, and the voxel spacing: --spacing X,Y,Z (mm)";
const std::array kMagics{
    Magic{"\x89PNG"sv, 0, "a picture (PNG)", kStack},
    Magic{"\xFF\xD8\xFF"sv, 0, "a picture (JPEG)", kStack},
    Magic{"GIF8"sv, 0, "a picture (GIF)", kPicture},
    Magic{"WEBP"sv, 8, "a picture (WebP)", kPicture},
    Magic{"\0\0\0\x0CjP  "sv, 0, "a picture (JPEG 2000)", kPicture},
    Magic{"II*\0"sv, 0, "a picture or a stack of them (TIFF)", kStack},
    Magic{"MM\0*"sv, 0, "a picture or a stack of them (TIFF)", kStack},
    Magic{"%PDF"sv, 0, "a PDF document", kPicture},
    Magic{"PK\3\4"sv, 0, "a zip archive", kUnpack},
    Magic{"7z\xBC\xAF"sv, 0, "a 7z archive", kUnpack},
    Magic{"Rar!"sv, 0, "a rar archive", kUnpack},
    Magic{"\xFD"
          "7zXZ"sv,
          0, "compressed by xz", kUnpack},
    Magic{"BZh"sv, 0, "compressed by bzip2", kUnpack},
    Magic{"\x28\xB5\x2F\xFD"sv, 0, "compressed by zstd", kUnpack},
    Magic{"ustar"sv, 257, "a tar archive", kUnpack},
    Magic{"CDF\1"sv, 0, "a MINC 1 or another netCDF file", "convert MINC to NIfTI with mnc2nii"},
    Magic{"CDF\2"sv, 0, "a MINC 1 or another netCDF file", "convert MINC to NIfTI with mnc2nii"},
    Magic{"\x93NUMPY"sv, 0, "a NumPy array",
          "an array does not store its spacing: save it as NIfTI with nibabel, or as NRRD with pynrrd"},
    Magic{"MATLAB 5.0"sv, 0, "a MATLAB file",
          "save the volume as NIfTI (niftiwrite in MATLAB), with its spacing"},
    Magic{"SQLite format 3"sv, 0, "an SQLite database", "give the volume itself"},
    Magic{"PAR/REC"sv, 0, "a PAR/REC header of a Philips scanner", "convert it with dcm2niix"},
};

std::optional<FileKind> by_magic(std::string_view front) {
  for (const Magic& magic : kMagics)
    if (front.size() > magic.at && front.substr(magic.at).starts_with(magic.bytes))
      return FileKind{magic.what, magic.remedy, {}};
  return std::nullopt;
}

// ---- volumes that are read by palpate, possibly under another extension --------------------------

bool is_nifti(std::string_view front) {
  if (front.size() < 348) return false;
  const std::string_view size = front.substr(0, 4), magic = front.substr(344, 3);
  if (size == "\x5C\1\0\0"sv || size == "\0\0\1\x5C"sv) return magic == "n+1" || magic == "ni1";
  if (size != "\x1C\2\0\0"sv && size != "\0\0\2\x1C"sv) return false;
  return front.substr(4, 3) == "n+2" || front.substr(4, 3) == "ni2";
}

std::optional<FileKind> volume_kind(std::string_view front) {
  const auto volume = [](std::string_view format, const char* ending) {
    return FileKind{(format.front() == 'M' ? "a " : "an ") + std::string(format) + " volume",
                    std::string("give it a name that ends in ") + ending, format};
  };
  if (front.starts_with("NRRD000")) return volume("NRRD", ".nrrd (.nhdr if its voxels are in another file)");
  if (is_nifti(front)) return volume("NIfTI", ".nii, or .nii.gz when it is compressed");
  const auto equals = front.find('=');
  const std::string first_key = lower_case(trimmed(front.substr(0, std::min<std::size_t>(equals, 64))));
  if (equals != std::string_view::npos && (first_key == "objecttype" || first_key == "ndims"))
    return volume("MetaImage", ".mha (.mhd if its voxels are in another file)");
  return std::nullopt;
}

}  // namespace

std::string dicom_transfer_syntax(std::string_view front) {
  if (front.size() <= 132 || front.substr(128, 4) != "DICM") return "";
  const std::string_view uid = dicom_text(front.substr(132), "\x02\0\x10\0"sv);
  return std::string(uid.substr(0, uid.find('\0')));
}

std::optional<FileKind> kind_of(std::string_view front, const std::string& file_name, std::uint64_t size) {
  const std::string name = lower_case(file_name);
  if (front.empty()) return FileKind{"an empty file", "copy or download it again", {}};
  if (auto volume = volume_kind(front)) return volume;
  if (is_dicom(front)) {
    FileKind kind = dicom_kind(front);
    kind.dicom = true;
    return kind;
  }
  if (front.starts_with("\x89HDF\r\n")) {
    if (ends_with(name, ".mnc")) return FileKind{"a MINC 2 file", "convert it to NIfTI with mnc2nii", {}};
    return FileKind{"an HDF5 file, as used for recordings",
                    "to replay a recording use palpate replay FILE, to show it palpate report FILE",
                    {}};
  }
  if (ends_with(name, ".mgz") || ends_with(name, ".mgh"))
    return FileKind{"a FreeSurfer volume (MGH)", "convert it: mri_convert FILE volume.nii.gz", {}};
  if (ends_with(name, ".mrml") || front.find("<MRML") != std::string_view::npos)
    return FileKind{
        "a 3D Slicer scene (MRML)", "open it there, and save scan (.nrrd) and segmentation (.seg.nrrd)", {}};
  if (ends_with(name, ".mrb"))
    return FileKind{
        "a 3D Slicer scene (MRB)", "open it there, and save scan (.nrrd) and segmentation (.seg.nrrd)", {}};
  if (auto surface = surface_kind(front, name, size)) return surface;
  return by_magic(front);
}

}  // namespace palpate::volume_io
