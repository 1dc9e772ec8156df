from . import analysis_tables as analysis_tables, report_words as report_words, result_tables as result_tables
from .diagnosis_table import print_diagnosis as print_diagnosis, print_rule as print_rule
from .effects_table import catalogue as catalogue, print_catalogue as print_catalogue, print_entry as print_entry
from .finding_table import (
    finding_entries as finding_entries,
    print_finding as print_finding,
    print_findings_list as print_findings_list,
)
from .gains_table import print_gains as print_gains
from .inspection_table import print_inspection as print_inspection
from .number_format import short as short
from .result_tables import print_both as print_both
from .trends_table import print_trends as print_trends
