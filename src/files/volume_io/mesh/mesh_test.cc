#include "volume_io/mesh/mesh.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <random>

#include "base/test_files.h"
#include "base/test_seed.h"
#include "palpate/base/file.h"
#include "volume_io/formats/file_kind.h"
#include "volume_io/mesh/test_meshes.h"

namespace palpate::volume_io {
namespace {

using test_meshes::in_every_format;
using test_meshes::WrittenMesh;
using ::testing::HasSubstr;

// corners of all triangles, in order
std::vector<Eigen::Vector3d> corners_of(const TriangleMesh& mesh) {
  std::vector<Eigen::Vector3d> corners;
  for (const auto& triangle : mesh.triangles)
    for (const std::uint32_t n : triangle) corners.push_back(mesh.points[n]);
  return corners;
}

TriangleMesh awkward_mesh() {
  return test_meshes::moved(test_meshes::torus_mesh(12.25, 4.5, 12),
                            Eigen::AngleAxisd(0.7, Eigen::Vector3d(1, 2, 3).normalized()).toRotationMatrix(),
                            {-31.5, 77.125, 1e-3});
}

TEST(Mesh, EveryFormatHoldsTheSameTriangles) {
  const TriangleMesh mesh = awkward_mesh();
  for (const WrittenMesh& written : in_every_format(mesh)) {
    const auto file = parse_mesh(written.bytes, written.format, written.name);
    ASSERT_TRUE(file) << file.error().message();
    ASSERT_EQ(file->meshes.size(), 1u) << written.name;
    EXPECT_FALSE(file->space) << written.name;
    const auto received = corners_of(file->meshes.front()), wanted = corners_of(mesh);
    ASSERT_EQ(received.size(), wanted.size()) << written.name;
    for (std::size_t n = 0; n < received.size(); ++n)
      EXPECT_LT((received[n] - wanted[n]).norm(), 2e-5) << written.name << ", corner " << n;
  }
}

TEST(Mesh, DetectsTheFormatByContent) {
  for (const WrittenMesh& written : in_every_format(awkward_mesh())) {
    const auto kind =
        kind_of(std::string_view(written.bytes).substr(0, kKindBytes), written.name, written.bytes.size());
    ASSERT_TRUE(kind && kind->mesh) << written.name;
    EXPECT_EQ(*kind->mesh, written.format) << written.name;
  }
}

TEST(Mesh, UsesTheSpaceDeclaredBySlicer) {
  const TriangleMesh mesh = awkward_mesh();
  const std::string title = "3D Slicer output. SPACE=RAS";
  const std::vector<WrittenMesh> files{
      {"a.stl", MeshFormat::kStl, test_meshes::ascii_stl(mesh, title)},
      {"b.stl", MeshFormat::kStl, test_meshes::binary_stl(mesh, title)},
      {"c.obj", MeshFormat::kObj, test_meshes::obj(mesh, "# " + title + "\n")},
      {"d.ply", MeshFormat::kPly, test_meshes::ply(mesh, "binary_little_endian", title)},
      {"e.vtk", MeshFormat::kVtkLegacy, test_meshes::legacy_vtk(mesh, true, true, title)},
      {"f.vtp", MeshFormat::kVtkXml,
       test_meshes::vtp(
           mesh, "appended",
           "<FieldData><Array type=\"String\" Name=\"SPACE\" NumberOfTuples=\"1\" format=\"ascii\">82 65 83 "
           "0</Array></FieldData>\n")}};
  for (const WrittenMesh& written : files) {
    const auto file = parse_mesh(written.bytes, written.format, written.name);
    ASSERT_TRUE(file) << file.error().message();
    EXPECT_EQ(file->space, MeshSpace::kRas) << written.name;
    EXPECT_EQ(file->meshes.front().name, "") << written.name;
  }
}

TEST(Mesh, ObjectsAndSolidsAreStructuresOfTheirOwn) {
  const std::string two =
      "o femur\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\ng part\nf 1 3 4\no tibia\nv 5 0 0\nv 6 0 0\nv 5 "
      "\\\n1 0\n"
      "f -3 -2 -1\n";
  auto file = parse_mesh(two, MeshFormat::kObj, "two.obj");
  ASSERT_TRUE(file) << file.error().message();
  ASSERT_EQ(file->meshes.size(), 2u);
  EXPECT_EQ(file->meshes[0].name, "femur");
  EXPECT_EQ(file->meshes[0].triangles.size(), 2u);
  EXPECT_EQ(file->meshes[1].name, "tibia");
  EXPECT_EQ(file->meshes[1].points.back(), Eigen::Vector3d(5, 1, 0));

  // groups that share points are parts of one surface
  file = parse_mesh("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\ng a\nf 1 2 3\ng b\nf 1 3 4\n", MeshFormat::kObj,
                    "one.obj");
  ASSERT_TRUE(file) << file.error().message();
  ASSERT_EQ(file->meshes.size(), 1u);
  EXPECT_EQ(file->meshes[0].name, "");
  EXPECT_EQ(file->meshes[0].triangles.size(), 2u);

  // objects are separate structures even if they share points
  file = parse_mesh("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\no a\nf 1 2 3\no b\nf 1 3 4\n", MeshFormat::kObj,
                    "two.obj");
  ASSERT_TRUE(file) << file.error().message();
  ASSERT_EQ(file->meshes.size(), 2u);
  EXPECT_EQ(file->meshes[1].name, "b");

  const TriangleMesh box = test_meshes::box_mesh({1, 2, 3});
  file = parse_mesh(test_meshes::ascii_stl(box, "liver") + test_meshes::ascii_stl(box, "spleen"),
                    MeshFormat::kStl, "s.stl");
  ASSERT_TRUE(file) << file.error().message();
  ASSERT_EQ(file->meshes.size(), 2u);
  EXPECT_EQ(file->meshes[1].name, "spleen");
}

TEST(Mesh, PolygonsBecomeFansAndStripsTurnEverySecondTriangle) {
  auto file = parse_mesh("v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n", MeshFormat::kObj, "p.obj");
  ASSERT_TRUE(file);
  EXPECT_EQ(file->meshes[0].triangles.size(), 2u);
  file = parse_mesh(
      "# vtk DataFile Version 3.0\nt\nASCII\nDATASET POLYDATA\nFIELD FieldData 2\nname 1 1 string\nJohn "
      "Doe\nnumbers 2 2 int\n1 2 3 4\nPOINTS 4 double\n0 0 0 1 0 0 0 1 0 1 1 0\nLINES 1 3\n2 0 "
      "1\nTRIANGLE_STRIPS 1 "
      "5\n4 0 1 2 3\n",
      MeshFormat::kVtkLegacy, "s.vtk");
  ASSERT_TRUE(file) << file.error().message();
  ASSERT_EQ(file->meshes[0].triangles.size(), 2u);
  const auto corners = corners_of(file->meshes[0]);
  for (std::size_t n = 0; n < 6; n += 3)
    EXPECT_GT((corners[n + 1] - corners[n]).cross(corners[n + 2] - corners[n]).z(), 0) << n;
}

TEST(Mesh, ReportsUnsupportedContent) {
  const TriangleMesh box = test_meshes::box_mesh({1, 1, 1});
  std::string packed = test_meshes::vtp(box, "packed");
  packed.replace(packed.find("vtkZLibDataCompressor"), 21, "vtkLZ4DataCompressor ");
  const auto refusal = [](const std::string& bytes, MeshFormat format) {
    const auto file = parse_mesh(bytes, format, "f");
    return file ? std::string("is read") : file.error().message();
  };
  EXPECT_THAT(refusal(packed, MeshFormat::kVtkXml), HasSubstr("compressed by vtkLZ4DataCompressor"));
  EXPECT_THAT(
      refusal("# vtk DataFile Version 3.0\nt\nASCII\nDATASET UNSTRUCTURED_GRID\n", MeshFormat::kVtkLegacy),
      HasSubstr("holds no POLYDATA"));
  EXPECT_THAT(refusal("v 0 0 0\n", MeshFormat::kObj), HasSubstr("holds no triangle"));
  EXPECT_THAT(refusal("v 0 0 0\nf 1 2 3\n", MeshFormat::kObj),
              HasSubstr("line 2 is a face with missing corners"));
  EXPECT_THAT(refusal("v 0 nan 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\n", MeshFormat::kObj), HasSubstr("not finite"));
  std::string cut = test_meshes::binary_stl(box);
  cut.resize(cut.size() - 70);
  EXPECT_THAT(refusal(cut, MeshFormat::kStl), HasSubstr("it ends after 10 of 12 triangles"));
}

TEST(Mesh, RejectsLargeMeshesByName) {
  const auto refusal = [](const std::string& bytes) {
    const auto file = parse_mesh(bytes, MeshFormat::kPly, "f");
    return file ? std::string("is read") : file.error().message();
  };
  const std::string head = "ply\nformat binary_little_endian 1.0\n",
                    point = "property uchar x\nproperty uchar y\nproperty uchar z\n",
                    face = "property list uint uchar vertex_indices\nend_header\n";
  // points without triangles, and a face with more corners than there may be triangles
  EXPECT_THAT(
      refusal(head + "element vertex " + std::to_string(kMaxPoints + 1) + "\n" + point + "element face 1\n" +
              face + std::string(3 * (kMaxPoints + 1), 'a') + std::string("\3\0\0\0\0\1\2", 7)),
      HasSubstr("more than 1000000 triangles or 3000000 points"));
  const std::uint32_t corners = kMaxTriangles + 3;
  std::string count(4, '\0');
  for (std::size_t n = 0; n < 4; ++n) count[n] = static_cast<char>(corners >> 8 * n & 0xFF);
  EXPECT_THAT(refusal(head + "element vertex 3\n" + point + "element face 1\n" + face +
                      std::string("\0\0\0\1\0\0\0\1\0", 9) + count + std::string(corners, '\0')),
              HasSubstr("more than 1000000 triangles"));
}

TEST(Mesh, IgnoresExtensionsOfOtherPrograms) {
  const TriangleMesh box = test_meshes::box_mesh({1, 2, 3});
  // metadata that VTK stores for an array, such as its range
  std::string keyed = test_meshes::vtp(box, "ascii");
  const auto cells = keyed.find("</DataArray>", keyed.find("<Polys>"));
  ASSERT_NE(cells, std::string::npos);
  keyed.insert(cells,
               "<InformationKey name=\"L2_NORM_RANGE\" location=\"vtkDataArray\" length=\"2\"><Value "
               "index=\"0\">1</Value></InformationKey>");
  auto file = parse_mesh(keyed, MeshFormat::kVtkXml, "keyed.vtp");
  ASSERT_TRUE(file) << file.error().message();
  EXPECT_EQ(file->meshes[0].triangles.size(), box.triangles.size());
  // NaN in a list that is not a face's
  file = parse_mesh(
      "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float "
      "z\nelement "
      "face 1\nproperty list uchar int vertex_indices\nproperty list uchar float texcoord\nend_header\n0 0 "
      "0\n1 "
      "0 0\n0 1 0\n3 0 1 2 2 nan 0.5\n",
      MeshFormat::kPly, "t.ply");
  ASSERT_TRUE(file) << file.error().message();
  std::string capitals = test_meshes::ascii_stl(box, "LIVER");
  std::ranges::transform(capitals, capitals.begin(),
                         [](char c) { return c >= 'a' && c <= 'z' ? static_cast<char>(c - 32) : c; });
  file = parse_mesh(capitals, MeshFormat::kStl, "c.stl");
  ASSERT_TRUE(file) << file.error().message();
  EXPECT_EQ(file->meshes[0].triangles.size(), box.triangles.size());
}

// a tag that repeats a word before a long blank took minutes
TEST(Mesh, ATagTakesNoLongerThanItIsLong) {
  std::string tag = "<VTKFile ";
  for (int n = 0; n < 100'000; ++n) tag += "type ";
  tag += std::string(2'000'000, ' ') + ">";
  EXPECT_FALSE(parse_mesh(tag, MeshFormat::kVtkXml, "f"));
}

// complete reads or a single error; time and memory remain proportional to the data
TEST(DamagedMesh, CutsAndFlippedBitsAreErrorsOrOtherMeshes) {
  std::mt19937 random(test::test_seed());
  const auto written = in_every_format(test_meshes::torus_mesh(12, 4, 12));
  std::size_t cuts_read = 0;
  for (const WrittenMesh& one : written)
    for (int n = 0; n < 300; ++n) {
      std::string bytes = one.bytes;
      const bool cut = n % 2 == 0;
      if (cut) bytes.resize(random() % bytes.size());
      for (unsigned flips = cut ? 0 : 1 + random() % 4; flips > 0; --flips) {
        char& byte = bytes[random() % bytes.size()];
        byte = static_cast<char>(byte ^ static_cast<char>(1 << random() % 8));
      }
      const auto file = parse_mesh(bytes, one.format, one.name);
      if (!file) {
        EXPECT_FALSE(file.error().what.empty());
        EXPECT_EQ(file.error().where, one.name);
        continue;
      }
      cuts_read += cut;
      for (const TriangleMesh& mesh : file->meshes)
        for (const auto& triangle : mesh.triangles)
          for (const std::uint32_t corner : triangle) ASSERT_LT(corner, mesh.points.size()) << one.name;
    }
  // an OBJ has no end mark, and data after the cells of a legacy file are skipped
  EXPECT_LT(cuts_read, written.size() * 300 / 2 / 4);
}

// Seeds of mesh_fuzzer. PALPATE_WRITE_SEEDS=src/files/volume_io/mesh/mesh_fuzzer_corpus writes them again.
TEST(MeshSeeds, AreUnderstood) {
  const std::filesystem::path folder =
      std::filesystem::path(PALPATE_SOURCE_DIR) / "src/files/volume_io/mesh/mesh_fuzzer_corpus";
  const char* const target = std::getenv("PALPATE_WRITE_SEEDS");
  for (const WrittenMesh& one : in_every_format(test_meshes::box_mesh({1, 2, 3}))) {
    if (target != nullptr) test::write_text(std::filesystem::path(target) / one.name, one.bytes);
    const auto seed = palpate::read_file(folder / one.name, 1 << 20);
    ASSERT_TRUE(seed.ok()) << one.name;
    const auto file = parse_mesh(*seed, one.format, one.name);
    ASSERT_TRUE(file.ok()) << file.error().message();
    ASSERT_EQ(file->meshes.size(), 1u) << one.name;
    EXPECT_EQ(file->meshes[0].triangles.size(), 12u) << one.name;
  }
}

}  // namespace
}  // namespace palpate::volume_io
