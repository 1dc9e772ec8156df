from . import (
    analysis_shapes as analysis_shapes,
    gains_shapes as gains_shapes,
    parameter_shapes as parameter_shapes,
    trend_shapes as trend_shapes,
)
from .analysis_shapes import (
    ComparisonFile as ComparisonFile,
    SpectraFile as SpectraFile,
)
from .gains_shapes import (
    GAINS_SCHEMA as GAINS_SCHEMA,
    DesignSection as DesignSection,
    Figure as Figure,
    GainsFile as GainsFile,
)
from .inspection_shapes import (
    INSPECTION_SCHEMA as INSPECTION_SCHEMA,
    ChannelSection as ChannelSection,
    ExperimentSection as ExperimentSection,
    InspectionFile as InspectionFile,
    PartSection as PartSection,
)
from .parameter_shapes import (
    FindingSection as FindingSection,
    MeasureSection as MeasureSection,
    ParameterFile as ParameterFile,
    Shape as Shape,
    ValidationFile as ValidationFile,
)
from .site_shapes import (
    NEXT as NEXT,
    ONE_KIND as ONE_KIND,
    PREVIOUS as PREVIOUS,
    SITE_SCHEMA as SITE_SCHEMA,
    BarSection as BarSection,
    MachineSection as MachineSection,
    RecordingsSection as RecordingsSection,
    SiteFile as SiteFile,
    StepSection as StepSection,
)
from .trend_shapes import TRENDS_SCHEMA as TRENDS_SCHEMA, TrendsFile as TrendsFile
