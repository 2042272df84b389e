#include "palpate/navigation/result_files.h"

#include <algorithm>
#include <cmath>

#include "palpate/geometry/decompositions.h"
#include "palpate/json/json.h"

namespace palpate {
namespace {

// upper bound of plausible lengths
constexpr double kMaxLength_mm = 1e5;
constexpr const char* kTipRemedy = "give the file written by palpate pivot -o";
constexpr const char* kRegistrationRemedy = "give the file written by palpate register -o";

Json list_of(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}
template <class Matrix>
Json rows_of(const Matrix& matrix) {
  Json rows = Json::array();
  for (Eigen::Index r = 0; r < matrix.rows(); ++r) {
    Json row = Json::array();
    for (Eigen::Index c = 0; c < matrix.cols(); ++c) row.push_back(matrix(r, c));
    rows.push_back(row);
  }
  return rows;
}
Eigen::Matrix4d matrix_of(const Transform<Patient, Tracker>& X) {
  Eigen::Matrix4d matrix = Eigen::Matrix4d::Identity();
  matrix.topLeftCorner<3, 3>() = X.linear();
  matrix.topRightCorner<3, 1>() = X.translation();
  return matrix;
}
std::string written(const Json& json) {
  return json.dump(2) + "\n";
}

// a valid number from `low` to kMaxLength_mm
std::optional<double> number_in(const Json& json, const char* key, double low) {
  const Json* found = json.find(key);
  if (found == nullptr || !found->is_number()) return {};
  const double value = found->get<double>();
  return value >= low && value <= kMaxLength_mm ? std::optional(value) : std::nullopt;
}
// an array of numbers is a matrix of one column
template <int Rows, int Columns>
std::optional<Eigen::Matrix<double, Rows, Columns>> numbers_in(const Json& json, const char* key) {
  const Json* found = json.find(key);
  if (found == nullptr || !found->is_array() || found->size() != Rows) return {};
  Eigen::Matrix<double, Rows, Columns> out;
  for (int r = 0; r < Rows; ++r) {
    const Json& row = (*found)[static_cast<std::size_t>(r)];
    if (Columns > 1 && (!row.is_array() || row.size() != Columns)) return {};
    for (int c = 0; c < Columns; ++c) {
      const Json& each = Columns > 1 ? row[static_cast<std::size_t>(c)] : row;
      if (!each.is_number()) return {};
      out(r, c) = each.get<double>();
    }
  }
  if (!out.allFinite() || out.cwiseAbs().maxCoeff() > kMaxLength_mm) return {};
  return out;
}

bool is_rigid(const Eigen::Matrix4d& matrix) {
  const Eigen::Matrix3d r = matrix.topLeftCorner<3, 3>();
  return (r * r.transpose() - Eigen::Matrix3d::Identity()).norm() < 1e-6 && r.determinant() > 0 &&
         matrix.row(3) == Eigen::RowVector4d(0, 0, 0, 1);
}
bool is_covariance(const Matrix6d& matrix) {
  const double size = matrix.cwiseAbs().maxCoeff();
  if ((matrix - matrix.transpose()).cwiseAbs().maxCoeff() > 1e-9 * size) return false;
  return symmetric_eigen(matrix).values[0] >= -1e-9 * size;
}

}  // namespace

std::string tip_text(const PivotCalibration& found) {
  Json json{{"tip_mm", list_of(found.tip.eigen())},
            {"pivot_mm", list_of(found.pivot.eigen())},
            {"rms_mm", found.rms_mm},
            {"tip_error_mm", found.tip_error_mm},
            {"turn_deg", found.turn_deg},
            {"poses", found.is_outlier.size()},
            {"used", found.used}};
  Json outliers = Json::array();
  for (std::size_t n = 0; n < found.is_outlier.size(); ++n)
    if (found.is_outlier[n]) outliers.push_back(n + 1);
  json["left_out"] = outliers;
  return written(json);
}

Result<ToolTip> parse_tip(std::string_view text, const std::string& where) {
  const auto bad = [&](const char* what) { return Error{ErrorKind::kBadInput, what, where, kTipRemedy}; };
  const std::optional<Json> parsed = Json::parse(text);
  if (!parsed || !parsed->is_object()) return bad("is not a file of a tool's tip");
  const auto at = numbers_in<3, 1>(*parsed, "tip_mm");
  if (!at) return bad("has no tip_mm of three numbers");
  const auto error_mm = number_in(*parsed, "tip_error_mm", 0), scatter_mm = number_in(*parsed, "rms_mm", 0);
  if (!error_mm || !scatter_mm) return bad("does not state the error of the tip (tip_error_mm, rms_mm)");
  return ToolTip{Point<TrackedTool>(*at), *error_mm, *scatter_mm};
}

std::string registration_text(const RegistrationOutcome& outcome) {
  const PointRegistration& points = outcome.by_points;
  // figures of the point registration, whether or not a surface registration follows
  Json of_points{{"patient_from_tracker", rows_of(matrix_of(points.patient_from_tracker))},
                 {"fre_mm", points.fre_mm},
                 {"fle_known", outcome.is_fle_known}};
  if (!outcome.is_fle_known)
    of_points["fle_mm"] = {points.fle_scale, points.min_fle_scale, points.max_fle_scale};
  Json residuals = Json::array(), targets = Json::array();
  for (std::size_t n = 0; n < outcome.names.size(); ++n) {
    residuals.push_back({{"name", outcome.names[n]}, {"mm", points.residuals_mm[n]}});
    if (!outcome.spread_mm.empty()) residuals.back()["held_mm"] = outcome.spread_mm[n];
  }
  of_points["points"] = residuals;
  if (outcome.fle_scale) {
    const RigidError error = rigid_error(points, *outcome.fle_scale);
    for (const Point<Patient>& target : outcome.targets) {
      const ErrorSpread wrong = error_at(error, target);
      targets.push_back(
          {{"at_mm", list_of(target.eigen())}, {"tre_rms_mm", wrong.rms_mm}, {"tre_95_mm", wrong.max_mm}});
    }
    of_points["centroid_mm"] = list_of(error.about.eigen());
    of_points["covariance"] = rows_of(error.covariance);
  }
  of_points["targets"] = targets;
  Json json{{"patient_from_tracker", rows_of(matrix_of(outcome.patient_from_tracker()))}};
  if (!outcome.reference.empty()) json["reference"] = outcome.reference;
  json["by_points"] = of_points;
  if (outcome.surface) {
    const SurfaceRegistration& found = outcome.surface->found;
    json["surface"] = {{"structure", outcome.surface->structure},
                       {"points", found.distances_mm.size()},
                       {"trimmed", std::count(found.is_trimmed.begin(), found.is_trimmed.end(), true)},
                       {"rms_mm", found.rms_mm},
                       {"moved_mm", found.moved_mm},
                       {"turned_deg", found.turned_deg},
                       {"hold", found.hold}};
  }
  return written(json);
}

Result<RegisteredPatient> parse_registration(std::string_view text, const std::string& where) {
  const auto bad = [&](const char* what) {
    return Error{ErrorKind::kBadInput, what, where, kRegistrationRemedy};
  };
  const std::optional<Json> parsed = Json::parse(text);
  if (!parsed || !parsed->is_object()) return bad("is not a file of a registration");
  const auto matrix = numbers_in<4, 4>(*parsed, "patient_from_tracker");
  if (!matrix || !is_rigid(*matrix))
    return bad("has no patient_from_tracker that is a rigid transform, four rows of four numbers");
  const Json* points = parsed->find("by_points");
  if (points == nullptr || !points->is_object()) return bad("has no by_points");
  RegisteredPatient out;
  out.patient_from_tracker = {matrix->topLeftCorner<3, 3>(), matrix->topRightCorner<3, 1>()};
  const auto fre_mm = number_in(*points, "fre_mm", 0);
  if (!fre_mm) return bad("has no fre_mm in by_points");
  out.fre_mm = *fre_mm;
  if (points->contains("covariance")) {
    const auto centroid = numbers_in<3, 1>(*points, "centroid_mm");
    const auto covariance = numbers_in<6, 6>(*points, "covariance");
    if (!centroid || !covariance || !is_covariance(*covariance))
      return bad("has an invalid covariance in by_points (translation and rotation about centroid_mm)");
    out.error = RigidError{Point<Patient>(*centroid), *covariance};
  }
  if (const Json* reference = parsed->find("reference")) {
    if (!reference->is_string()) return bad("has an invalid name as reference");
    out.reference = reference->get<std::string>();
  }
  return out;
}

}  // namespace palpate
