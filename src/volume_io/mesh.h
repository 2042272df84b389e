#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/geometry/geometry.h"
#include "palpate/volume_io/volume_io.h"

/// Surface meshes, as files hold them. Plain numbers; what becomes of them on a grid says mesh_labels.h.
namespace palpate::volume_io {

/// Triangles of one structure, counter-clockwise seen from outside. In the file's own axes and unit, or in
/// LPS mm, as whoever has it says.
struct TriangleMesh {
  std::string name;  ///< of the object, the group or the solid in the file; may be any text, or empty
  std::vector<Eigen::Vector3d> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< indices of points, each within their number
};

enum class MeshFormat { kStl, kObj, kPly, kVtkLegacy, kVtkXml };

struct MeshFile {
  std::vector<TriangleMesh> meshes;  ///< at least one, each with a triangle, points all finite
  std::optional<MeshSpace> space;    ///< as 3D Slicer writes it: "SPACE=LPS" in a comment
};

/// The most triangles of one file, and its most points, which are as many as those of triangles that share
/// none: their memory and what closing their holes takes fit into the process that reads (reader/confine.h).
constexpr std::size_t kMostTriangles = 1'000'000, kMostPoints = 3 * kMostTriangles;
/// The most bytes of one, texts being the longest.
constexpr std::size_t kMostMeshBytes = std::size_t{1} << 28;

/// Parses a whole file. Polygons become fans of triangles, which winding numbers take for the polygon itself
/// where that is planar, convex or not. The bytes are untrusted.
///
/// STL (3D Systems 1988), ASCII with any number of solids, and binary; Wavefront OBJ, an object for each `o`
/// or `g`; PLY (Turk 1994), ASCII and binary of both byte orders; VTK's legacy polydata, versions 1 to 5.1,
/// and XML polydata (.vtp; data in text, base64 and appended, raw or packed by zlib): vtk.org, VTK File
/// Formats.
/// @param source  names the bytes in errors
/// Errors: cut short, damaged, of a kind that is not read; no triangle; too many.
Result<MeshFile> parse_mesh(std::string_view bytes, MeshFormat format, const std::string& source);

// ---- shared by the parsers ------------------------------------------------------------------------------

/// Puts what a file says into meshes, and bounds it.
class MeshBuilder {
 public:
  explicit MeshBuilder(std::string source) : source_(std::move(source)) {}

  void begin(std::string_view name);  ///< of the mesh that follows
  void space_from(std::string_view comment);
  void set_space(MeshSpace space) { file_.space = space; }
  /// More than kMostPoints are left out, and finish() tells.
  void add_point(const Eigen::Vector3d& point);
  std::size_t points() const { return file_.meshes.back().points.size(); }
  /// A polygon by the indices of its points, from 0 on, all of one mesh. False: an index is out of range,
  /// or there are too many triangles, which finish() tells.
  bool add_polygon(const std::vector<std::int64_t>& corners);
  bool add_triangle(std::int64_t a, std::int64_t b, std::int64_t c);

  /// Makes one mesh of all, without a name.
  void join();

  /// What is wrong with the file; of one that has too many triangles or points, that.
  Error damaged(const std::string& how) const;
  Error too_many();
  Error refused(const std::string& what, const std::string& remedy) const;
  /// Drops meshes without a triangle. Errors: as parse_mesh().
  Result<MeshFile> finish();

 private:
  std::string source_;
  MeshFile file_;
  std::size_t triangles_ = 0, points_ = 0;  // of all meshes
  bool too_many_ = false;
};

/// A decimal number, a leading plus included.
std::optional<double> mesh_number(std::string_view text);

Result<MeshFile> parse_stl(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_obj(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_ply(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_vtk_legacy(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_vtk_xml(std::string_view bytes, MeshBuilder builder);

}  // namespace palpate::volume_io
