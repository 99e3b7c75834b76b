tpm_macros::model_file!(slider);

fn main() {}
