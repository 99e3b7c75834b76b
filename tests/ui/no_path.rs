tpm_runtime::model_file!(slider);

fn main() {}
