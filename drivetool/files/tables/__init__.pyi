from . import report_words as report_words
from .catalogue_tables import (
    catalogue as catalogue,
    finding_entries as finding_entries,
    print_catalogue as print_catalogue,
    print_entry as print_entry,
    print_finding as print_finding,
    print_findings_list as print_findings_list,
)
from .diagnosis_table import print_rule as print_rule
from .file_tables import print_file as print_file
from .number_format import short as short
from .result_tables import (
    print_both as print_both,
    print_findings as print_findings,
    without_unidentified as without_unidentified,
)
