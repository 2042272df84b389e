#pragma once

#include <zlib.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <numbers>
#include <string>
#include <vector>

#include "volume_io/mesh/mesh.h"

/// Meshes of shapes, and files of them as written by other programs.
namespace palpate::volume_io::test_meshes {

using Vector3 = Eigen::Vector3d;

/// Mesh of u x v points on a closed surface, or on one that is open along its first and last row of v.
template <class PointOf>
TriangleMesh mesh_of_grid(std::uint32_t us, std::uint32_t vs, bool closed_in_v, const PointOf& point_of) {
  TriangleMesh mesh;
  for (std::uint32_t v = 0; v < vs; ++v)
    for (std::uint32_t u = 0; u < us; ++u)
      mesh.points.push_back(
          point_of(static_cast<double>(u) / us, static_cast<double>(v) / (closed_in_v ? vs : vs - 1)));
  const std::uint32_t rows = closed_in_v ? vs : vs - 1;
  for (std::uint32_t v = 0; v < rows; ++v)
    for (std::uint32_t u = 0; u < us; ++u) {
      const std::uint32_t a = v * us + u, b = v * us + (u + 1) % us, c = (v + 1) % vs * us + u,
                          d = (v + 1) % vs * us + (u + 1) % us;
      mesh.triangles.push_back({a, b, d});
      mesh.triangles.push_back({a, d, c});
    }
  return mesh;
}

/// Sphere around the origin. Each pole consists of many coincident points.
inline TriangleMesh sphere_mesh(double radius, std::uint32_t around = 96) {
  constexpr double kPi = std::numbers::pi;
  return mesh_of_grid(around, around / 2, false, [&](double u, double v) {
    const double turn = 2 * kPi * u, fall = kPi * (1 - v);
    // the poles exactly, so that the surface closes
    const double ring = v == 0 || v == 1 ? 0 : radius * std::sin(fall);
    return Vector3(ring * std::cos(turn), ring * std::sin(turn), radius * std::cos(fall));
  });
}

inline TriangleMesh torus_mesh(double ring, double tube, std::uint32_t around = 96) {
  constexpr double kPi = std::numbers::pi;
  return mesh_of_grid(around, around / 2, true, [&](double u, double v) {
    const double r = ring + tube * std::cos(2 * kPi * v);
    return Vector3(r * std::cos(2 * kPi * u), r * std::sin(2 * kPi * u), tube * std::sin(2 * kPi * v));
  });
}

/// Cuboid around the origin.
inline TriangleMesh box_mesh(const Vector3& half) {
  TriangleMesh mesh;
  for (int n = 0; n < 8; ++n)
    mesh.points.push_back(half.cwiseProduct(Vector3(n & 1 ? 1 : -1, n & 2 ? 1 : -1, n & 4 ? 1 : -1)));
  const std::array<std::array<std::uint32_t, 4>, 6> faces{
      {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}}};
  for (const auto& [a, b, c, d] : faces) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  }
  return mesh;
}

inline TriangleMesh moved(TriangleMesh mesh, const Eigen::Matrix3d& turn, const Vector3& to) {
  for (Vector3& point : mesh.points) point = turn * point + to;
  return mesh;
}

// ---- files ----------------------------------------------------------------------------------------------

inline std::string number(double value) {
  char text[40];
  std::snprintf(text, sizeof text, "%.9g", value);
  return text;
}

template <class T>
std::string raw(T value, bool big_endian = false) {
  std::array<char, sizeof(T)> bytes;
  std::memcpy(bytes.data(), &value, sizeof value);
  if (big_endian) std::reverse(bytes.begin(), bytes.end());
  return {bytes.begin(), bytes.end()};
}

inline std::string ascii_stl(const TriangleMesh& mesh, const std::string& title = "") {
  std::string text = "solid " + title + "\n";
  for (const auto& t : mesh.triangles) {
    text += "  facet normal 0 0 0\n    outer loop\n";
    for (const std::uint32_t n : t) {
      const Vector3& p = mesh.points[n];
      text += "      vertex " + number(p.x()) + " " + number(p.y()) + " " + number(p.z()) + "\n";
    }
    text += "    endloop\n  endfacet\n";
  }
  return text + "endsolid " + title + "\n";
}

inline std::string binary_stl(const TriangleMesh& mesh, std::string header = "") {
  header.resize(80, ' ');
  std::string bytes = header + raw(static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& t : mesh.triangles) {
    bytes += std::string(12, '\0');
    for (const std::uint32_t n : t)
      for (int a = 0; a < 3; ++a) bytes += raw(static_cast<float>(mesh.points[n][a]));
    bytes += std::string(2, '\0');
  }
  return bytes;
}

inline std::string obj(const TriangleMesh& mesh, const std::string& first = "") {
  std::string text = "# a surface\n" + first;
  for (const Vector3& p : mesh.points)
    text += "v " + number(p.x()) + " " + number(p.y()) + " " + number(p.z()) + "\n";
  text += "vn 0 0 1\n";
  for (const auto& [a, b, c] : mesh.triangles)
    text += "f " + std::to_string(a + 1) + "//1 " + std::to_string(b + 1) + "//1 " + std::to_string(c + 1) +
            "//1\n";
  return text;
}

/// PLY file.
/// @param order  "ascii", "binary_little_endian" or "binary_big_endian"
inline std::string ply(const TriangleMesh& mesh, const std::string& order, const std::string& comment = "") {
  std::string bytes =
      "ply\nformat " + order + " 1.0\ncomment " + comment + "\nelement vertex " +
      std::to_string(mesh.points.size()) +
      "\nproperty float x\nproperty double y\nproperty float z\nproperty uchar red\nelement face " +
      std::to_string(mesh.triangles.size()) +
      "\nproperty list uchar int vertex_indices\nelement edge 1\nproperty int vertex1\nend_header\n";
  const bool big = order == "binary_big_endian", text = order == "ascii";
  for (const Vector3& p : mesh.points)
    bytes += text ? number(p.x()) + " " + number(p.y()) + " " + number(p.z()) + " 7\n"
                  : raw(static_cast<float>(p.x()), big) + raw(p.y(), big) +
                        raw(static_cast<float>(p.z()), big) + "\7";
  for (const auto& t : mesh.triangles) {
    bytes += text ? "3" : "\3";
    for (const std::uint32_t n : t)
      bytes += text ? " " + std::to_string(n) : raw(static_cast<std::int32_t>(n), big);
    if (text) bytes += "\n";
  }
  return bytes + (text ? "0\n" : raw(std::int32_t{0}, big));
}

/// Legacy VTK file of version 3, or of 5.1 with two arrays for the cells.
inline std::string legacy_vtk(const TriangleMesh& mesh, bool binary, bool two_arrays,
                              const std::string& title = "a surface") {
  std::string bytes = std::string("# vtk DataFile Version ") + (two_arrays ? "5.1" : "3.0") + "\n" + title +
                      "\n" + (binary ? "BINARY" : "ASCII") + "\nDATASET POLYDATA\nPOINTS " +
                      std::to_string(mesh.points.size()) + " float\n";
  for (const Vector3& p : mesh.points)
    for (int a = 0; a < 3; ++a) bytes += binary ? raw(static_cast<float>(p[a]), true) : number(p[a]) + " ";
  bytes += "\nMETADATA\nINFORMATION 1\nNAME L2_NORM_RANGE LOCATION vtkDataArray\nDATA 2 0 1\n\n";
  const std::size_t cells = mesh.triangles.size();
  const auto put = [&](std::uint32_t n, bool wide) {
    if (!binary)
      bytes += std::to_string(n) + " ";
    else
      bytes += wide ? raw(std::int64_t{n}, true) : raw(static_cast<std::int32_t>(n), true);
  };
  if (two_arrays) {
    bytes += "POLYGONS " + std::to_string(cells + 1) + " " + std::to_string(3 * cells) +
             "\nOFFSETS vtktypeint64\n";
    for (std::uint32_t n = 0; n <= cells; ++n) put(3 * n, true);
    bytes += "\nCONNECTIVITY vtktypeint64\n";
    for (const auto& t : mesh.triangles)
      for (const std::uint32_t n : t) put(n, true);
  } else {
    bytes += "POLYGONS " + std::to_string(cells) + " " + std::to_string(4 * cells) + "\n";
    for (const auto& t : mesh.triangles) {
      put(3, false);
      for (const std::uint32_t n : t) put(n, false);
    }
  }
  return bytes + "\nCELL_DATA " + std::to_string(cells) + "\nSCALARS what float 1\n";
}

inline std::string base64(const std::string& bytes) {
  constexpr std::string_view kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string text;
  for (std::size_t n = 0; n < bytes.size(); n += 3) {
    std::uint32_t bits = 0;
    for (std::size_t b = 0; b < 3; ++b)
      bits = bits << 8 | (n + b < bytes.size() ? static_cast<unsigned char>(bytes[n + b]) : 0u);
    for (std::size_t b = 0; b < 4; ++b)
      text += n + b > bytes.size() ? '=' : kLetters[bits >> (18 - 6 * b) & 63];
  }
  return text;
}

/// XML VTK file.
/// @param format  "ascii", "binary", "packed" (binary, compressed by zlib) or "appended"
inline std::string vtp(const TriangleMesh& mesh, const std::string& format, const std::string& field = "") {
  const bool packed = format == "packed", appended = format == "appended";
  std::string tail;
  const auto array = [&](const std::string& head, const std::string& words, const std::string& bytes) {
    std::string tag = "<DataArray " + head + " format=\"" + (packed ? "binary" : format) + "\"";
    if (appended) {
      tag += " offset=\"" + std::to_string(tail.size()) + "\"/>\n";
      tail += raw(static_cast<std::uint64_t>(bytes.size())) + bytes;
      return tag;
    }
    tag += ">\n";
    if (format == "ascii") return tag + words + "</DataArray>\n";
    if (!packed)
      return tag + base64(raw(static_cast<std::uint64_t>(bytes.size())) + bytes) + "</DataArray>\n";
    // blocks of 1000 bytes, the last one shorter
    const std::size_t block = 1000, blocks = (bytes.size() + block - 1) / block;
    std::string header = raw(static_cast<std::uint64_t>(blocks)) + raw(static_cast<std::uint64_t>(block)) +
                         raw(static_cast<std::uint64_t>(bytes.size() % block)),
                body;
    for (std::size_t n = 0; n < blocks; ++n) {
      const std::string part = bytes.substr(n * block, block);
      std::string out(part.size() + 100, '\0');
      uLongf size = out.size();
      ::compress(reinterpret_cast<Bytef*>(out.data()), &size, reinterpret_cast<const Bytef*>(part.data()),
                 part.size());
      header += raw(static_cast<std::uint64_t>(size));
      body += out.substr(0, size);
    }
    return tag + base64(header) + base64(body) + "</DataArray>\n";
  };
  std::string points, corners, ends, point_words, corner_words, end_words;
  for (const Vector3& p : mesh.points)
    for (int a = 0; a < 3; ++a) {
      points += raw(static_cast<float>(p[a]));
      point_words += number(p[a]) + " ";
    }
  for (std::uint32_t n = 0; n < mesh.triangles.size(); ++n) {
    for (const std::uint32_t corner : mesh.triangles[n]) {
      corners += raw(std::int64_t{corner});
      corner_words += std::to_string(corner) + " ";
    }
    ends += raw(std::int64_t{3 * n + 3});
    end_words += std::to_string(3 * n + 3) + "\n";
  }
  std::string text =
      "<?xml version=\"1.0\"?>\n<VTKFile type=\"PolyData\" version=\"1.0\" byte_order=\"LittleEndian\" "
      "header_type=\"UInt64\"" +
      std::string(packed ? " compressor=\"vtkZLibDataCompressor\"" : "") + ">\n<PolyData>\n" + field +
      "<Piece NumberOfPoints=\"" + std::to_string(mesh.points.size()) + "\" NumberOfPolys=\"" +
      std::to_string(mesh.triangles.size()) + "\">\n<Points>\n";
  text += array("type=\"Float32\" Name=\"Points\" NumberOfComponents=\"3\"", point_words, points) +
          "</Points>\n<Polys>\n";
  text += array("type=\"Int64\" Name=\"connectivity\"", corner_words, corners);
  text += array("type=\"Int64\" Name=\"offsets\"", end_words, ends) + "</Polys>\n</Piece>\n</PolyData>\n";
  if (appended) text += "<AppendedData encoding=\"raw\">\n_" + tail + "\n</AppendedData>\n";
  return text + "</VTKFile>\n";
}

struct WrittenMesh {
  std::string name;  ///< File name.
  MeshFormat format{};
  std::string bytes;
};
/// The mesh in every supported format.
inline std::vector<WrittenMesh> in_every_format(const TriangleMesh& mesh) {
  return {{"ascii.stl", MeshFormat::kStl, ascii_stl(mesh, "ball")},
          {"binary.stl", MeshFormat::kStl, binary_stl(mesh, "solid as some programs begin it")},
          {"one.obj", MeshFormat::kObj, obj(mesh)},
          {"ascii.ply", MeshFormat::kPly, ply(mesh, "ascii")},
          {"little.ply", MeshFormat::kPly, ply(mesh, "binary_little_endian")},
          {"big.ply", MeshFormat::kPly, ply(mesh, "binary_big_endian")},
          {"old.vtk", MeshFormat::kVtkLegacy, legacy_vtk(mesh, false, false)},
          {"old_binary.vtk", MeshFormat::kVtkLegacy, legacy_vtk(mesh, true, false)},
          {"new.vtk", MeshFormat::kVtkLegacy, legacy_vtk(mesh, false, true)},
          {"new_binary.vtk", MeshFormat::kVtkLegacy, legacy_vtk(mesh, true, true)},
          {"ascii.vtp", MeshFormat::kVtkXml, vtp(mesh, "ascii")},
          {"binary.vtp", MeshFormat::kVtkXml, vtp(mesh, "binary")},
          {"packed.vtp", MeshFormat::kVtkXml, vtp(mesh, "packed")},
          {"appended.vtp", MeshFormat::kVtkXml, vtp(mesh, "appended")}};
}

}  // namespace palpate::volume_io::test_meshes
