#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

/// What DICOM files carry that says who the patient is, for somebody who wants to know before he gives them
/// away. palpate itself writes none of it.
namespace palpate {

/// By the profiles of DICOM PS3.15 Annex E (Basic Application Level Confidentiality), which say of each
/// attribute what becomes of it.
enum class IdentifierKind {
  kName,         ///< of persons: each value of type PN
  kId,           ///< numbers and codes given to patient, visit, order, device; addresses
  kPatient,      ///< what the patient is like: sex, age, size, weight, pregnancy
  kDate,         ///< dates and times: DA, DT, TM; the time zone
  kUid,          ///< unique identifiers, those of the standard itself left out
  kText,         ///< free texts: ST, LT, UT, and descriptions and comments of other types
  kInstitution,  ///< where and by which machine: institution, station, application entities (AE)
  kPrivate,      ///< elements of makers: groups of an odd number
  kPicture,      ///< said to be burnt into the pixels, or drawn over them: annotations, overlays, curves
};
inline constexpr std::size_t kIdentifierKinds = 9;
/// "names of persons"
std::string in_words(IdentifierKind kind);

/// Beyond so many different values of an element they are no longer counted.
inline constexpr std::size_t kMostIdentifierValues = 1000;

struct IdentifierRow {
  IdentifierKind kind{};
  std::string what;           ///< "PatientName (0010,0010)"
  std::size_t files = 0;      ///< in how many files it has a value
  std::size_t different = 0;  ///< how many values there are; kMostIdentifierValues: so many or more
  std::string example;        ///< one of them, where values are asked for
};

struct IdentifierReport {
  std::size_t files = 0;            ///< of DICOM that were read
  std::vector<IdentifierRow> rows;  ///< by kind, then by tag
  /// Of how many files it is not said whether something is burnt into their pixels (BurnedInAnnotation
  /// (0028,0301)).
  std::size_t burnt_in_unsaid = 0;
  std::vector<std::string> notes;  ///< what was not read
};

/// @param file    one of DICOM, of any kind, or a folder of them; a DICOMDIR with the files that it names
/// @param values  whether IdentifierRow::example is wanted
/// Errors: no file of DICOM that can be read; interrupted.
Result<IdentifierReport> find_identifiers(const std::filesystem::path& file, bool values,
                                          const Progress& progress = {});

}  // namespace palpate
