#include "processing/report/html.h"

#include <fmt/core.h>

namespace mesorig::report {
namespace {

constexpr std::string_view kStyle = R"(
:root { color: #262626; background: #fff; font: 16px/1.55 system-ui, "Segoe UI", "DejaVu Sans", sans-serif; }
body { max-width: 60rem; margin: 0 auto; padding: 2.5rem 1.5rem 4rem; }
h1 { font-size: 1.9rem; line-height: 1.2; margin: 0; }
h2 { font-size: 1.2rem; margin: 2.6rem 0 .8rem; padding-bottom: .3rem; border-bottom: 1px solid #ddd; }
.subtitle { color: #666; margin: .3rem 0 0; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: .38rem .9rem .38rem 0; border-bottom: 1px solid #ececec; vertical-align: top; }
th { color: #666; font-weight: 500; font-size: .88rem; }
td.number, th.number { text-align: right; white-space: nowrap; }
.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(17rem, 1fr)); gap: 1.4rem; }
.figures.single { grid-template-columns: 1fr; }
figure { margin: 0; }
figure img { width: 100%; height: auto; display: block; border: 1px solid #e4e4e4; }
figcaption { color: #555; font-size: .9rem; margin-top: .35rem; }
p.note, ul.skipped { color: #555; font-size: .95rem; }
@media print { body { padding: 0; } h2 { break-after: avoid; } figure, tr { break-inside: avoid; } }
)";

bool IsNumber(std::string_view text) {
  if (text == "–") return true;
  if (!text.empty() && (text[0] == '-' || text[0] == '+')) text.remove_prefix(1);
  return !text.empty() && text[0] >= '0' && text[0] <= '9';
}

std::string Row(const std::vector<std::string>& cells, const std::vector<bool>& right, bool head) {
  std::string row = "<tr>";
  for (size_t k = 0; k < cells.size(); ++k) {
    const std::string_view tag = head ? "th" : "td";
    row += fmt::format("<{0}{1}>{2}</{0}>", tag, right[k] ? " class=\"number\"" : "",
                       Escaped(cells[k]));
  }
  return row + "</tr>\n";
}

}  // namespace

std::string Escaped(std::string_view text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&': out += "&amp;"; break;
      case '<': out += "&lt;"; break;
      case '>': out += "&gt;"; break;
      case '"': out += "&quot;"; break;
      case '\'': out += "&#39;"; break;
      default: out += c;
    }
  }
  return out;
}

std::string Table(const std::vector<std::vector<std::string>>& rows) {
  if (rows.empty()) return "";
  // A column is one of numbers when all its cells are.
  std::vector<bool> right(rows[0].size(), rows.size() > 1);
  for (size_t r = 1; r < rows.size(); ++r) {
    for (size_t k = 0; k < right.size(); ++k) right[k] = right[k] && IsNumber(rows[r][k]);
  }
  std::string table = "<table>\n";
  for (size_t r = 0; r < rows.size(); ++r) table += Row(rows[r], right, r == 0);
  return table + "</table>\n";
}

std::string Section(std::string_view heading, std::string_view body_html) {
  return fmt::format("<section>\n<h2>{}</h2>\n{}</section>\n", Escaped(heading), body_html);
}

std::string Paragraph(std::string_view text) {
  return fmt::format("<p class=\"note\">{}</p>\n", Escaped(text));
}

std::string Figure(std::string_view file, std::string_view caption) {
  return fmt::format("<figure><a href=\"{0}\"><img src=\"{0}\" alt=\"{1}\"></a><figcaption>{1}</figcaption></figure>\n",
                     Escaped(file), Escaped(caption));
}

std::string Figures(const std::vector<std::string>& figures_html) {
  std::string grid =
      fmt::format("<div class=\"figures{}\">\n", figures_html.size() == 1 ? " single" : "");
  for (const std::string& figure : figures_html) grid += figure;
  return grid + "</div>\n";
}

std::string Page(std::string_view title, std::string_view subtitle, std::string_view body_html) {
  return fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<title>{0}</title>\n<style>{2}</style>\n</head>\n<body>\n<h1>{0}</h1>\n"
      "<p class=\"subtitle\">{1}</p>\n{3}</body>\n</html>\n",
      Escaped(title), Escaped(subtitle), kStyle, body_html);
}

}  // namespace mesorig::report
