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
#include "palpate/volume_io/placement_options.h"

/// Surface meshes and their parsers. Plain data; mesh_labels.h rasterises them.
namespace palpate::volume_io {

/// Triangles of one structure, counter-clockwise seen from outside. Either in the file's own axes and unit or
/// in LPS mm, depending on the owner.
struct TriangleMesh {
  std::string name;  ///< Name of the object, group or solid in the file; any text, or empty.
  std::vector<Eigen::Vector3d> points;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< Vertex indices, all valid.
};

enum class MeshFormat { kStl, kObj, kPly, kVtkLegacy, kVtkXml };

struct MeshFile {
  std::vector<TriangleMesh> meshes;  ///< At least one, each with at least one triangle; all points finite.
  std::optional<MeshSpace> space;    ///< Stated by 3D Slicer as "SPACE=LPS" in a comment.
};

/// Maximum number of triangles and points of a file; there are three times as many points as triangles if no
/// two triangles share one. Their memory, including that for closing holes, fits into the reader process
/// (reader/confine.h).
constexpr std::size_t kMaxTriangles = 1'000'000, kMaxPoints = 3 * kMaxTriangles;
/// Maximum size of a mesh file, text being the longest; bytes.
constexpr std::size_t kMaxMeshBytes = std::size_t{1} << 28;

/// Parses a whole file. Polygons are converted to triangle fans, whose winding number equals that of the
/// polygon if it is planar, convex or not. The bytes are untrusted.
///
/// STL (3D Systems 1988), ASCII with any number of solids, and binary; Wavefront OBJ, one object per `o` or
/// `g`; PLY (Turk 1994), ASCII and binary in both byte orders; VTK's legacy polydata, versions 1 to 5.1, and
/// XML polydata (.vtp; text, base64 and appended data, raw or compressed by zlib): vtk.org, VTK File Formats.
/// @param source  names the bytes in errors
Result<MeshFile> parse_mesh(std::string_view bytes, MeshFormat format, const std::string& source);

// ---- shared by the parsers ------------------------------------------------------------------------------

/// Collects points and polygons of a file into meshes, within limits.
class MeshBuilder {
 public:
  explicit MeshBuilder(std::string source) : source_(std::move(source)) {}

  void begin(std::string_view name);  ///< Starts the next mesh.
  void read_space(std::string_view comment);
  void set_space(MeshSpace space) { file_.space = space; }
  /// Adds a point; points beyond kMaxPoints are dropped, and finish() reports them.
  void add_point(const Eigen::Vector3d& point);
  std::size_t points() const { return file_.meshes.back().points.size(); }
  /// Adds a polygon of the current mesh by the indices of its points, from 0 on. Returns false if an index is
  /// out of range, or if there are too many triangles, which finish() reports.
  bool add_polygon(const std::vector<std::int64_t>& corners);
  bool add_triangle(std::int64_t a, std::int64_t b, std::int64_t c);

  /// Merges all meshes into one without a name.
  void join();

  /// Error for a damaged file; for one with too many triangles or points, that error.
  Error damaged(const std::string& how) const;
  Error too_many();
  Error refused(const std::string& what, const std::string& remedy) const;
  /// Drops meshes without triangles and returns the rest. Errors: as parse_mesh().
  Result<MeshFile> finish();

 private:
  std::string source_;
  MeshFile file_;
  std::size_t triangles_ = 0, points_ = 0;  // totals over all meshes
  bool too_many_ = false;
};

/// Parses a decimal number; a leading plus is accepted.
std::optional<double> mesh_number(std::string_view text);

Result<MeshFile> parse_stl(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_obj(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_ply(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_vtk_legacy(std::string_view bytes, MeshBuilder builder);
Result<MeshFile> parse_vtk_xml(std::string_view bytes, MeshBuilder builder);

}  // namespace palpate::volume_io
