from .delivery import (
    deliver as deliver,
    draw as draw,
    print_table as print_table,
    recordings_drawn_on_failure as recordings_drawn_on_failure,
    show_entries as show_entries,
    show_findings as show_findings,
    table_console as table_console,
)
from .exit_codes import (
    DONE as DONE,
    MISSED as MISSED,
    USAGE as USAGE,
    exit_code as exit_code,
    guarded as guarded,
    say as say,
    write_stdout as write_stdout,
)
