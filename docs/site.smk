# One stage of a site for Snakemake: steady of every recording. `snakemake --snakefile site.smk --cores 2`

RECORDINGS = glob_wildcards("site/{name}.steady.parquet").name


rule all:
    input:
        expand("site/{name}.steady.yaml", name=RECORDINGS),


rule steady:
    input:
        "site/{name}.steady.parquet",
    output:
        "site/{name}.steady.yaml",
    params:
        options=config.get("steady", ""),
    threads: 1
    shell:
        "drivetool steady {input:q} {params.options} --out {output:q} --quiet"
