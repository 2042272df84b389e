#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "palpate/cohort/case.h"
#include "palpate/cohort/cohort_table.h"

namespace palpate {

/// All cases of a table with their results.
struct CohortResults {
  std::vector<CohortCase> cases;
  std::vector<std::optional<CaseResult>> results;  ///< Result of each case; empty: not done
};
/// Table with a row per case and a column per figure, followed by those of each structure. Deterministic.
std::string cohort_tsv(const CohortResults& cohort);
/// Durations of each case, from its times.json; s.
std::string times_tsv(const CohortResults& cohort, const std::filesystem::path& folder);
/// HTML page with sorting and comparison, including the cases' pictures.
std::string cohort_page(const CohortResults& cohort, const std::filesystem::path& folder,
                        const std::string& program);

}  // namespace palpate
