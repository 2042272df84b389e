#include "volume_io/mesh/mesh.h"

#include <cmath>

#include "volume_io/labels/label_text.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

void MeshBuilder::begin(std::string_view name) {
  // A mesh without triangles is replaced, so that names alone take no memory.
  if (file_.meshes.empty() || !file_.meshes.back().triangles.empty()) file_.meshes.emplace_back();
  points_ -= file_.meshes.back().points.size();
  file_.meshes.back().points.clear();
  file_.meshes.back().name = std::string(trimmed(name));
}

void MeshBuilder::add_point(const Eigen::Vector3d& point) {
  if (points_ == kMaxPoints) too_many_ = true;
  if (too_many_) return;
  file_.meshes.back().points.push_back(point);
  ++points_;
}

void MeshBuilder::join() {
  if (file_.meshes.size() < 2) return;
  TriangleMesh& whole = file_.meshes.front();
  whole.name.clear();
  for (std::size_t n = 1; n < file_.meshes.size(); ++n) {
    const auto first = static_cast<std::uint32_t>(whole.points.size());
    const TriangleMesh part = std::move(file_.meshes[n]);
    whole.points.insert(whole.points.end(), part.points.begin(), part.points.end());
    for (const auto& [a, b, c] : part.triangles) whole.triangles.push_back({first + a, first + b, first + c});
  }
  file_.meshes.resize(1);
}

void MeshBuilder::read_space(std::string_view comment) {
  constexpr std::string_view kTag = "SPACE=";
  const auto at = comment.find(kTag);
  if (at == std::string_view::npos) return;
  const std::string_view value = comment.substr(at + kTag.size(), 3);
  if (value == "LPS") file_.space = MeshSpace::kLps;
  if (value == "RAS") file_.space = MeshSpace::kRas;
}

bool MeshBuilder::add_triangle(std::int64_t a, std::int64_t b, std::int64_t c) {
  if (triangles_ == kMaxTriangles) too_many_ = true;
  if (too_many_) return false;
  TriangleMesh& mesh = file_.meshes.back();
  const auto count = static_cast<std::int64_t>(mesh.points.size());
  for (const std::int64_t corner : {a, b, c})
    if (corner < 0 || corner >= count) return false;
  mesh.triangles.push_back(
      {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  ++triangles_;
  return true;
}

bool MeshBuilder::add_polygon(const std::vector<std::int64_t>& corners) {
  for (std::size_t n = 2; n < corners.size(); ++n)
    if (!add_triangle(corners[0], corners[n - 1], corners[n])) return false;
  return true;
}

Error MeshBuilder::damaged(const std::string& how) const {
  if (too_many_)
    return bad_input(source_,
                     "has more than " + std::to_string(kMaxTriangles) + " triangles or " +
                         std::to_string(kMaxPoints) + " points, which is too many",
                     "simplify it first, for example with 3D Slicer's Surface Toolbox (Decimate)");
  return bad_input(source_, "is damaged: " + how, "copy it again, or export it again");
}

Error MeshBuilder::too_many() {
  too_many_ = true;
  return damaged("");
}

Error MeshBuilder::refused(const std::string& what, const std::string& remedy) const {
  return bad_input(source_, what, remedy);
}

Result<MeshFile> MeshBuilder::finish() {
  std::erase_if(file_.meshes, [](const TriangleMesh& mesh) { return mesh.triangles.empty(); });
  if (too_many_) return damaged("");
  if (file_.meshes.empty())
    return bad_input(source_, "holds no triangle", "export the surface again, as triangles");
  // limit for the geometric computations
  constexpr double kMaxCoordinate = 1e9;
  for (const TriangleMesh& mesh : file_.meshes)
    for (const Eigen::Vector3d& point : mesh.points)
      if (!(point.cwiseAbs().maxCoeff() <= kMaxCoordinate) || !point.allFinite())
        return damaged("it has a point whose coordinates are not finite or too large");
  return std::move(file_);
}

std::optional<double> mesh_number(std::string_view text) {
  if (text.starts_with('+')) text.remove_prefix(1);
  return parse_number<double>(text);
}

Result<MeshFile> parse_mesh(std::string_view bytes, MeshFormat format, const std::string& source) {
  MeshBuilder builder(source);
  switch (format) {
    case MeshFormat::kStl:
      return parse_stl(bytes, std::move(builder));
    case MeshFormat::kObj:
      return parse_obj(bytes, std::move(builder));
    case MeshFormat::kPly:
      return parse_ply(bytes, std::move(builder));
    case MeshFormat::kVtkLegacy:
      return parse_vtk_legacy(bytes, std::move(builder));
    case MeshFormat::kVtkXml:
      return parse_vtk_xml(bytes, std::move(builder));
  }
  return builder.damaged("its format is unknown");
}

}  // namespace palpate::volume_io
