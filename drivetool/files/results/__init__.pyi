from .both_motors import sides_of as sides_of, swap_file as swap_file
from .comparison import comparison_file as comparison_file
from .diagnosis import diagnosis_file as diagnosis_file, sections_before as sections_before
from .diagnosis_input import (
    base_findings as base_findings,
    check_base as check_base,
    check_holdout as check_holdout,
    verdict_finding as verdict_finding,
)
from .gains import controller_of as controller_of, gains_file as gains_file, load_gains as load_gains
from .inspection import channel_plot as channel_plot, inspection_file as inspection_file
from .parquet_file import recording_bytes as recording_bytes, table_bytes as table_bytes
from .result_file import (
    Inputs as Inputs,
    dump as dump,
    estimate_file as estimate_file,
    file_sections as file_sections,
    finding_sections as finding_sections,
    tool_section as tool_section,
    validation_file as validation_file,
)
from .run_file import run_table as run_table
from .spectra import spectra_file as spectra_file, write_curves as write_curves
