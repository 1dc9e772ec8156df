from .delivery import (
    deliver as deliver,
    draw as draw,
    draw_recordings as draw_recordings,
    print_findings as print_findings,
    print_table as print_table,
    show_entries as show_entries,
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
