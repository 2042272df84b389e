#include "volume_io/formats/file_kind.h"

#include <gtest/gtest.h>

#include <cstring>

namespace palpate::volume_io {
namespace {

using namespace std::string_literals;

std::string kind(const std::string& bytes, const std::string& name = "file", std::uint64_t size = 0) {
  const auto found = kind_of(bytes, name, size);
  if (!found) return "";
  EXPECT_FALSE(found->remedy.empty()) << name;
  return found->what;
}

// beginning of a DICOM file: its meta header, and the data set if that is silent
std::string dicom(const std::string& header_class, const std::string& class_in_data = "") {
  const auto uid = [](const std::string& tag, std::string value) {
    if (value.size() % 2) value += '\0';
    return tag + "UI" + static_cast<char>(value.size()) + '\0' + value;
  };
  std::string bytes = std::string(128, '\0') + "DICM" + "\x02\0\0\0UL\x04\0\xC0\0\0\0"s;
  if (!header_class.empty()) bytes += uid("\x02\0\x02\0"s, header_class);
  if (!class_in_data.empty()) bytes += uid("\x08\0\x16\0"s, class_in_data);
  return bytes + std::string(64, '\0');
}

TEST(FileKind, TellsDicomObjectsApart) {
  const std::string storage = "1.2.840.10008.5.1.4.1.1.";
  EXPECT_EQ(kind(dicom(storage + "2")), "a DICOM file");
  EXPECT_EQ(kind(dicom(storage + "66.4")), "a DICOM segmentation (SEG)");
  EXPECT_EQ(kind(dicom(storage + "66.7")), "a DICOM segmentation (SEG)");
  EXPECT_EQ(kind(dicom(storage + "481.3")), "a DICOM structure set (RTSTRUCT)");
  EXPECT_EQ(kind(dicom("", storage + "66.4")), "a DICOM segmentation (SEG)");
  EXPECT_EQ(kind(dicom("1.2.840.10008.1.3.10")), "a DICOMDIR, the list of contents of a DICOM disc");
  EXPECT_EQ(kind(dicom("")), "a DICOM file");
  EXPECT_TRUE(kind_of(dicom(storage + "4"), "x", 0)->dicom_image);
  EXPECT_FALSE(kind_of(dicom(storage + "66.4"), "x", 0)->dicom_image);
  // without a preamble, with explicit and implicit types
  EXPECT_EQ(kind("\x08\0\x05\0CS\x0A\0ISO_IR 100 more of it"s), "a DICOM file");
  EXPECT_EQ(kind("\x08\0\x05\0\x0A\0\0\0ISO_IR 100 more of it"s), "a DICOM file");
}

TEST(FileKind, KnowsSurfaces) {
  std::string binary(84 + 2 * 50, 'x');
  const std::uint32_t two = 2;
  std::memcpy(binary.data() + 80, &two, 4);
  EXPECT_EQ(kind(binary, "knee", binary.size()), "a surface (STL)");
  EXPECT_EQ(kind(binary, "knee", binary.size() + 1), "") << "of another length it is none";
  EXPECT_EQ(kind("solid knee\n  facet normal 0 0 1\n", "knee.txt"), "a surface (STL)");
  EXPECT_EQ(kind("solid ground\n", "notes.txt"), "") << "a text that begins so";
  EXPECT_EQ(kind("ply\nformat ascii 1.0\n"), "a surface (PLY)");
  EXPECT_EQ(kind("# made\nv 0 0 1\nv 1 0 0\n", "KNEE.OBJ"), "a surface (OBJ)");
  EXPECT_EQ(kind("# made\nv 0 0 1\n", "notes.txt"), "");
  EXPECT_EQ(kind("# vtk DataFile Version 3.0\nx\nASCII\nDATASET POLYDATA\n"), "a surface (VTK polydata)");
  EXPECT_EQ(kind("# vtk DataFile Version 3.0\nx\nASCII\nDATASET STRUCTURED_POINTS\n"),
            "an image in VTK's own format");
  EXPECT_EQ(kind("<?xml version=\"1.0\"?>\n<VTKFile type=\"ImageData\" version=\"0.1\">"),
            "an image in VTK's own format");
}

TEST(FileKind, KnowsPicturesArchivesAndOtherFormats) {
  EXPECT_EQ(kind("\x89PNG\r\n\x1a\n"s), "a picture (PNG)");
  EXPECT_EQ(kind("\xFF\xD8\xFF\xE0"s), "a picture (JPEG)");
  EXPECT_EQ(kind("PK\3\4xxxx"), "a zip archive");
  EXPECT_EQ(kind(std::string(257, 'a') + "ustar\0"s), "a tar archive");
  EXPECT_EQ(kind("\x89HDF\r\n\x1a\n"s, "brain.mnc"), "a MINC 2 file");
  EXPECT_EQ(kind("\x89HDF\r\n\x1a\n"s, "run.h5"), "an HDF5 file, as used for recordings");
  EXPECT_EQ(kind("CDF\1\0\0\0\0"s, "brain.mnc"), "a MINC 1 or another netCDF file");
  EXPECT_EQ(kind("\0\0\0\1\0\0\1\0"s, "aseg.MGZ"), "a FreeSurfer volume (MGH)");
  EXPECT_EQ(kind(""), "an empty file");
}

TEST(FileKind, KnowsVolumesUnderAnotherName) {
  const auto volume = [](const std::string& bytes) {
    const auto found = kind_of(bytes, "scan.dat", 0);
    return found ? std::string(found->readable_format) : "";
  };
  EXPECT_EQ(volume("NRRD0005\ntype: uint8\n"), "NRRD");
  EXPECT_EQ(volume("ObjectType = Image\nNDims = 3\n"), "MetaImage");
  EXPECT_EQ(volume("NDims=3\n"), "MetaImage");
  std::string nifti(352, '\0');
  std::memcpy(nifti.data(), "\x5C\1\0\0", 4);
  EXPECT_EQ(volume(nifti), "") << "Analyze 7.5";
  std::memcpy(nifti.data() + 344, "n+1", 4);
  EXPECT_EQ(volume(nifti), "NIfTI");
  std::memcpy(nifti.data(), "\0\0\2\x1Cn+2", 8);
  EXPECT_EQ(volume(nifti), "NIfTI");
}

TEST(FileKind, TextHasNoKind) {
  EXPECT_EQ(kind("title = \"Knee\"\n[data]\n", "scene.toml"), "");
  EXPECT_EQ(kind("value\tname\n", "names.tsv"), "");
  EXPECT_EQ(kind("MMORPG", "notes"), "");
  // truncated input is never read beyond its end
  const std::string dicom_file = dicom("1.2.840.10008.5.1.4.1.1.66.4");
  for (std::size_t bytes = 0; bytes <= dicom_file.size(); ++bytes) (void)kind(dicom_file.substr(0, bytes));
}

}  // namespace
}  // namespace palpate::volume_io
