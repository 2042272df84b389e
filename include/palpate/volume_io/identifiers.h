#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// Report of the patient identifiers that DICOM files contain, for users who want to check before sharing
/// them. palpate itself writes none of these.
namespace palpate {

/// Category of an identifier, by the profiles of DICOM PS3.15 Annex E (Basic Application Level
/// Confidentiality), which specify how each attribute is to be de-identified.
enum class IdentifierKind {
  kName,         ///< Names of persons: every value of type PN.
  kId,           ///< Numbers and codes of patient, visit, order or device; addresses.
  kPatient,      ///< Characteristics of the patient: sex, age, size, weight, pregnancy.
  kDate,         ///< Dates and times (DA, DT, TM) and the time zone.
  kUid,          ///< Unique identifiers, except those defined by the standard itself.
  kText,         ///< Free text: ST, LT, UT, and descriptions and comments of other types.
  kInstitution,  ///< Place and machine: institution, station, application entities (AE).
  kPrivate,      ///< Private elements of vendors: groups of an odd number.
  kPicture,      ///< Declared to be burnt into the pixels, or drawn over them: annotations, overlays, curves.
};
inline constexpr std::size_t kIdentifierKinds = 9;
/// Text for the user, such as "names of persons".
std::string description_of(IdentifierKind kind);

/// Upper limit for counting the distinct values of an element.
inline constexpr std::size_t kMaxIdentifierValues = 1000;

/// Occurrences of one element in all files.
struct IdentifierRow {
  IdentifierKind kind{};
  std::string what;           ///< "PatientName (0010,0010)"
  std::size_t files = 0;      ///< Number of files in which it has a value.
  std::size_t different = 0;  ///< Number of distinct values; kMaxIdentifierValues: that many or more.
  std::string example;        ///< One of the values, if values were requested.
};

struct IdentifierReport {
  std::size_t files = 0;            ///< Number of DICOM files read.
  std::vector<IdentifierRow> rows;  ///< Sorted by kind, then by tag.
  /// Number of files that do not state whether annotations are burnt into their pixels (BurnedInAnnotation
  /// (0028,0301)).
  std::size_t burnt_in_unstated = 0;
  std::vector<std::string> notes;  ///< Files and elements that were not read.
};

/// Collects the identifiers of DICOM files.
/// @param file    a DICOM file of any kind, or a folder of them; a DICOMDIR stands for itself and the files
///                that it references
/// @param values  whether to return IdentifierRow::example
/// Errors: no readable DICOM file; interrupted.
Result<IdentifierReport> find_identifiers(const std::filesystem::path& file, bool values,
                                          const Progress& progress = {});

}  // namespace palpate
