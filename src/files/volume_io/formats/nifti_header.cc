#include <Eigen/Geometry>
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "volume_io/formats/headers.h"

namespace palpate::volume_io {
namespace {

// fields by their offset in the header, in the file's byte order
class Bytes {
 public:
  Bytes(std::string_view bytes, bool swap) : bytes_(bytes), swap_(swap) {}

  template <class T>
  T at(std::size_t offset) const {
    char field[sizeof(T)];
    std::memcpy(field, bytes_.data() + offset, sizeof(T));
    if (swap_) std::reverse(field, field + sizeof(T));
    return std::bit_cast<T>(field);
  }

 private:
  std::string_view bytes_;
  bool swap_;
};

std::optional<Component> component_of(std::int16_t datatype) {
  switch (datatype) {
    case 2:
      return Component::kUint8;
    case 4:
      return Component::kInt16;
    case 8:
      return Component::kInt32;
    case 16:
      return Component::kFloat32;
    case 64:
      return Component::kFloat64;
    case 256:
      return Component::kInt8;
    case 512:
      return Component::kUint16;
    case 768:
      return Component::kUint32;
    case 1024:
      return Component::kInt64;
    case 1280:
      return Component::kUint64;
    default:
      return std::nullopt;
  }
}

constexpr std::int32_t kNifti1Bytes = 348, kNifti2Bytes = 540;

// version and byte order, from the first field, which is the header's size
struct Version {
  bool is_nifti2 = false, swap = false;
};
Result<Version> version_of(std::string_view bytes, const std::string& source) {
  const auto cut_short = [&] {
    return bad_input(source, "ends inside its header, after " + std::to_string(bytes.size()) + " bytes",
                     "the file is cut short: copy or download it again");
  };
  if (bytes.size() < kNifti1Bytes) return cut_short();
  for (const bool swap : {false, true}) {
    const auto size = Bytes(bytes, swap).at<std::int32_t>(0);
    if (size == kNifti1Bytes) return Version{false, swap};
    if (size != kNifti2Bytes) continue;
    if (bytes.size() < kNifti2Bytes) return cut_short();
    return Version{true, swap};
  }
  return bad_input(source, "is not a NIfTI file", "is its name right?");
}

// fields common to both versions, in the wider types of NIfTI-2
struct Fields {
  std::string_view magic;
  std::int64_t dim[8];
  std::int16_t datatype, bits;
  double pixdim[8], offset, slope, intercept;
  std::int32_t qform_code, sform_code, intent_code;
  double quaternion[3], qoffset[3], srow[12];
  int units;
};

template <class T, std::size_t kCount, class U>
void fill(U (&to)[kCount], const Bytes& bytes, std::size_t at) {
  for (std::size_t n = 0; n < kCount; ++n) to[n] = static_cast<U>(bytes.at<T>(at + n * sizeof(T)));
}

// https://nifti.nimh.nih.gov/pub/dist/src/niftilib/nifti1.h
Fields nifti1_fields(std::string_view text, const Bytes& bytes) {
  Fields f;
  f.magic = text.substr(344, 4);
  fill<std::int16_t>(f.dim, bytes, 40);
  f.intent_code = bytes.at<std::int16_t>(68);
  f.datatype = bytes.at<std::int16_t>(70);
  f.bits = bytes.at<std::int16_t>(72);
  fill<float>(f.pixdim, bytes, 76);
  f.offset = bytes.at<float>(108);
  f.slope = bytes.at<float>(112);
  f.intercept = bytes.at<float>(116);
  f.units = bytes.at<char>(123);
  f.qform_code = bytes.at<std::int16_t>(252);
  f.sform_code = bytes.at<std::int16_t>(254);
  fill<float>(f.quaternion, bytes, 256);
  fill<float>(f.qoffset, bytes, 268);
  fill<float>(f.srow, bytes, 280);
  return f;
}

// https://nifti.nimh.nih.gov/pub/dist/doc/nifti2.h
Fields nifti2_fields(std::string_view text, const Bytes& bytes) {
  Fields f;
  f.magic = text.substr(4, 4);
  f.datatype = bytes.at<std::int16_t>(12);
  f.bits = bytes.at<std::int16_t>(14);
  fill<std::int64_t>(f.dim, bytes, 16);
  fill<double>(f.pixdim, bytes, 104);
  f.offset = static_cast<double>(bytes.at<std::int64_t>(168));
  f.slope = bytes.at<double>(176);
  f.intercept = bytes.at<double>(184);
  f.qform_code = bytes.at<std::int32_t>(344);
  f.sform_code = bytes.at<std::int32_t>(348);
  fill<double>(f.quaternion, bytes, 352);
  fill<double>(f.qoffset, bytes, 376);
  fill<double>(f.srow, bytes, 400);
  f.units = bytes.at<std::int32_t>(500);
  f.intent_code = bytes.at<std::int32_t>(504);
  return f;
}

// labels and neuroanatomical names; all other positive codes are statistics, estimates and vectors; 0:
// unspecified
ValueMeaning meaning_of(std::int32_t intent_code) {
  constexpr std::int32_t kLabel = 1002, kNeuroName = 1003;
  if (intent_code == kLabel || intent_code == kNeuroName) return ValueMeaning::kLabels;
  return intent_code > 0 ? ValueMeaning::kMeasured : ValueMeaning::kUnspecified;
}

// voxel index to RAS mm by the standard's method 2
Eigen::Matrix<double, 3, 4> from_qform(const Fields& f) {
  const Eigen::Vector3d v(f.quaternion[0], f.quaternion[1], f.quaternion[2]);
  const double square = v.squaredNorm();
  const Eigen::Quaterniond q =
      square < 1 ? Eigen::Quaterniond(std::sqrt(1 - square), v.x(), v.y(), v.z())
                 : Eigen::Quaterniond(0, v.x(), v.y(), v.z()).normalized();  // a half turn, with rounding
  const double handedness = f.pixdim[0] < 0 ? -1 : 1;
  Eigen::Matrix<double, 3, 4> affine;
  affine.leftCols<3>() =
      q.toRotationMatrix() * Eigen::Vector3d(f.pixdim[1], f.pixdim[2], f.pixdim[3] * handedness).asDiagonal();
  affine.col(3) = Eigen::Vector3d(f.qoffset[0], f.qoffset[1], f.qoffset[2]);
  return affine;
}

// from voxel sizes only: axes are taken as LPS, as ITK does for NIfTI-1
Eigen::Matrix<double, 3, 4> from_voxel_sizes(const Fields& f) {
  Eigen::Matrix<double, 3, 4> affine = Eigen::Matrix<double, 3, 4>::Zero();
  affine.leftCols<3>() = Eigen::Vector3d(-f.pixdim[1], -f.pixdim[2], f.pixdim[3]).asDiagonal();
  return affine;
}

// Geometry of a NIfTI-1 by its qform or voxel sizes as ITK reads it: with numbers of 32 bits, by
// nifti_quatern_to_mat44() of the standard's nifti1_io.c.
HeaderGeometry geometry_in_32_bits(const Fields& f) {
  HeaderGeometry geometry;
  for (int a = 0; a < 3; ++a) geometry.spacing_mm[a] = f.pixdim[a + 1];
  if (f.qform_code <= 0) return geometry;
  double b = f.quaternion[0], c = f.quaternion[1], d = f.quaternion[2];
  double a = 1 - (b * b + c * c + d * d);
  constexpr double kHalfTurn = 1e-7;
  if (a < kHalfTurn) {
    const double scale = 1 / std::sqrt(b * b + c * c + d * d);
    b *= scale;
    c *= scale;
    d *= scale;
    a = 0;
  } else {
    a = std::sqrt(a);
  }
  const double x = f.pixdim[1], y = f.pixdim[2], z = f.pixdim[0] < 0 ? -f.pixdim[3] : f.pixdim[3];
  const double exact[3][3] = {
      {(a * a + b * b - c * c - d * d) * x, 2 * (b * c + a * d) * x, 2 * (b * d - a * c) * x},
      {2 * (b * c - a * d) * y, (a * a + c * c - b * b - d * d) * y, 2 * (c * d + a * b) * y},
      {2 * (b * d + a * c) * z, 2 * (c * d - a * b) * z, (a * a + d * d - c * c - b * b) * z}};
  // volatile: g++ 12 at -O3 keeps the digits that a float does not have
  volatile float columns[3][3];
  for (int axis = 0; axis < 3; ++axis)
    for (int r = 0; r < 3; ++r) columns[axis][r] = static_cast<float>(exact[axis][r]);
  for (int axis = 0; axis < 3; ++axis) {
    // RAS to LPS
    Eigen::Vector3d column;
    for (int r = 0; r < 3; ++r) column[r] = (r < 2 ? -1.0 : 1.0) * static_cast<double>(columns[axis][r]);
    const double length = std::sqrt(column[0] * column[0] + column[1] * column[1] + column[2] * column[2]);
    for (int r = 0; r < 3; ++r) geometry.direction(r, axis) = column[r] / length;
  }
  for (int r = 0; r < 3; ++r) geometry.origin_mm[r] = (r < 2 ? -1.0 : 1.0) * f.qoffset[r];
  return geometry;
}

Result<void> read_geometry(const Fields& f, bool is_nifti2, std::optional<NiftiForm> form,
                           const std::string& source, NiftiHeader& header) {
  header.has_geometry = f.qform_code > 0 || f.sform_code > 0;
  const int length_unit = f.units & 7;
  if (length_unit == 1 || length_unit == 3)
    return bad_input(source,
                     std::string("its lengths are in ") + (length_unit == 1 ? "metres" : "micrometres") +
                         ", but only millimetres are supported",
                     "convert it to millimetres");
  const auto finite = [](const auto& values) {
    return std::all_of(std::begin(values), std::end(values), [](double v) { return std::isfinite(v); });
  };
  if (f.sform_code > 0 && !(form == NiftiForm::kQform && f.qform_code > 0)) {
    header.affine.emplace();
    for (int n = 0; n < 12; ++n) (*header.affine)(n / 4, n % 4) = f.srow[n];
    if (!header.affine->allFinite())
      return bad_input(source, "its sform contains a non-finite value",
                       "use its qform, if any, with --form q, or copy the sform from the original scan");
    const bool comparable =
        f.qform_code > 0 && !form && finite(f.quaternion) && finite(f.qoffset) &&
        std::all_of(f.pixdim + 1, f.pixdim + 4, [](double size) { return std::isfinite(size) && size > 0; });
    if (comparable) header.other_affine = from_qform(f);
    return {};
  }
  // voxel sizes matter only without an sform
  Fields sized = f;
  for (std::size_t a = 0; a < 3; ++a) {
    double& size = sized.pixdim[a + 1];
    if (a >= header.axes.size())
      size = 1;
    else if (!std::isfinite(size) || size <= 0)
      return bad_input(source,
                       "its voxel size (pixdim) along axis " + std::to_string(a + 1) + " is not positive",
                       "copy it from the original scan");
  }
  if (f.qform_code > 0 && !(finite(f.quaternion) && finite(f.qoffset)))
    return bad_input(source, "its qform contains a non-finite value", "copy it from the original scan");
  // ITK does not read NIfTI-2
  if (is_nifti2 || f.sform_code > 0)
    header.affine = f.qform_code > 0 ? from_qform(sized) : from_voxel_sizes(sized);
  else
    header.geometry = geometry_in_32_bits(sized);
  return {};
}

}  // namespace

Result<NiftiHeader> parse_nifti_header(std::string_view text, const std::string& source,
                                       std::optional<NiftiForm> form) {
  const auto version = version_of(text, source);
  if (!version) return version.error();
  const Bytes bytes(text, version->swap);
  const Fields f = version->is_nifti2 ? nifti2_fields(text, bytes) : nifti1_fields(text, bytes);
  NiftiHeader header;
  const std::string_view separate =
      version->is_nifti2 ? std::string_view("ni2\0", 4) : std::string_view("ni1\0", 4);
  const std::string_view single =
      version->is_nifti2 ? std::string_view("n+2\0", 4) : std::string_view("n+1\0", 4);
  header.has_detached_data = f.magic == separate;
  if (!header.has_detached_data && f.magic != single) {
    if (version->is_nifti2) return bad_input(source, "is not a NIfTI file", "is its name right?");
    return bad_input(source, "is an Analyze 7.5 file, which does not define left and right",
                     "convert the original images to NIfTI");
  }

  const std::int64_t axes = f.dim[0];
  if (axes < 1 || axes > 7)
    return bad_input(source, "has " + std::to_string(axes) + " axes, its header is damaged");
  header.axes.assign(f.dim + 1, f.dim + 1 + axes);

  const auto component = component_of(f.datatype);
  if (!component)
    return bad_input(source, "its voxels are not plain numbers (datatype " + std::to_string(f.datatype) + ")",
                     "colour, complex and 128-bit values are not supported: convert it");
  header.voxels.component = *component;
  if (f.bits != static_cast<int>(8 * bytes_of(*component)))
    return bad_input(source, "its bits per voxel do not agree with its datatype");
  header.voxels.big_endian = (std::endian::native == std::endian::big) != version->swap;
  header.voxels.may_have_more = true;
  header.meaning = meaning_of(f.intent_code);

  // The standard requires 352 (NIfTI-2: 544) or more for voxels in the same file; some writers leave it 0.
  if (!std::isfinite(f.offset) || f.offset < 0 || f.offset > 1e9)
    return bad_input(source, "its vox_offset is damaged");
  header.voxels.skip = static_cast<std::uint64_t>(f.offset);
  header.header_bytes = version->is_nifti2 ? kNifti2Bytes : kNifti1Bytes;
  header.swapped = version->swap;
  if (!header.has_detached_data && header.voxels.skip < header.header_bytes)
    header.voxels.skip = header.header_bytes + 4;

  // slope 0 means no scaling
  if (std::isfinite(f.slope) && f.slope != 0) {
    header.voxels.slope = f.slope;
    if (std::isfinite(f.intercept)) header.voxels.intercept = f.intercept;
  }
  if (auto read = read_geometry(f, version->is_nifti2, form, source, header); !read) return read.error();
  return header;
}

}  // namespace palpate::volume_io
